"""What the report shows of models and scenes, taken from what the stages wrote."""
