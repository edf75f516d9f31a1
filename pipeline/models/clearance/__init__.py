"""The clearance model: distances of a path to detected objects, and which of them matter."""
