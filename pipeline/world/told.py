"""What stands on tables, as somebody told, instead of pictures."""


class Told:
    """A sequence of scenes that some models take in place of pictures; `perception.objects.Objects` is one."""
