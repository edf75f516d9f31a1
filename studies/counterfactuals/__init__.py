"""Study: which item makes a model reject a path, and how far would it have to move?"""
