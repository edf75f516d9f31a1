"""Which known user showed these labelled paths in a new scene, and was it a known one at all?"""
