"""Types of what the commands print with ``--json`` and of files of JSON; the JSON Schemas follow from them.

One structure is one object; an object has no other keys. A field that is only there in some cases has the default
``UNSET``. Where an object is a dataclass field by field, as the numbers that decide are, the dataclass is its type.
"""
