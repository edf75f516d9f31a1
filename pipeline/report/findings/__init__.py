"""What the results say, in sentences whose words follow the numbers: none can outlive what it was true of."""
