"""Mark what is told of scenes instead of pictures."""


class Told:
    """A sequence of scenes that some models take in place of pictures; `perception.objects.Objects` is one."""
