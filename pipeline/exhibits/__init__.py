"""What the report and the recordings show of models and scenes, taken from what the stages wrote."""
