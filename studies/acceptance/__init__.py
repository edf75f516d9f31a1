"""Which paths may a robot accept so that at most a promised share of them is invalid?"""
