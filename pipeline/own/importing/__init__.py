"""From a log (a ROS bag, a LeRobot data set, a csv file) to a folder of a person's own table (docs/import.md)."""
