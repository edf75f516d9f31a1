"""The clearance model: distances of a path from detected objects, and the relevance of each object to the user."""
