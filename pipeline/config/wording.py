"""What is said of a parameter that is wrong."""

from pydantic import ValidationError

TYPES = {  # pydantic's name of an error -> what was expected
    "int_type": "a whole number",
    "float_type": "a number",
    "finite_number": "a number that is finite",
    "bool_type": "true or false",
    "string_type": "a name",
    "none_required": "null",
    "list_type": "a list, such as [1, 3]",
    "too_short": "one at least",
    "dict_type": "a mapping from names to values",
    "model_type": "a mapping from names to values",
    "model_attributes_type": "a mapping from names to values",
}


def sentence(error: ValidationError) -> str:
    """The first parameter that is wrong: its name, what it is, and what was expected."""
    first = error.errors()[0]
    context, value = first.get("ctx", {}), first["input"]
    if first["loc"][-1:] == ("[key]",):
        what = context.get("expected", "letters; put it in quotes")
        return f"a name in {'.'.join(map(str, first['loc'][:-2]))} is {value!r}: expected {what}"
    keys = [str(key) for key in first["loc"] if not isinstance(key, int)]
    if keys[0:1] == ["variants"] and len(keys) > 2:
        del keys[2]  # its kind, which pydantic puts there to tell variants apart
    name = context.get("name", ".".join(keys))
    match first["type"]:
        case "missing":
            return f"parameter {name} is missing: expected a value, for conf/ gives each one"
        case "union_tag_not_found":
            return f"parameter {name}.kind is missing: expected one of the kinds of models"
        case "union_tag_invalid":
            return f"parameter {name}.kind is {context['tag']!r}: expected one of {context['expected_tags']}"
        case "extra_forbidden":
            return f"parameter {name} is {value!r}: expected none of that name"
        case other:
            what = context.get("expected") or TYPES.get(other, first["msg"])
            return f"parameter {name} is {context.get('value', value)!r}: expected {what}"
