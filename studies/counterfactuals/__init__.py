"""Which item does a model hold responsible for a rejected path, and how far would it have to move?"""
