"""Study: which known user demonstrated these labelled paths in a new scene, and was it a known user at all?"""
