# SPDX-License-Identifier: GPL-3.0-or-later
"""Writing TOML, as far as scene files and looks need it."""

import json


def value(thing):
    """A text, truth value, number or list of them as TOML."""
    if isinstance(thing, bool):
        return "true" if thing else "false"
    if isinstance(thing, str):
        return json.dumps(thing, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(thing, int):
        return str(thing)
    if isinstance(thing, float):
        return format(thing, ".9g")
    return "[" + ", ".join(value(item) for item in thing) + "]"


def key(name):
    """A key, in quotes where it needs them."""
    plain = name and all(c.isascii() and (c.isalnum() or c in "-_") for c in name)
    return name if plain else value(name)


def table(head, entries):
    """A table with its head, `[camera]` or `[[light]]`."""
    return "\n".join([head] + [f"{key(name)} = {value(thing)}" for name, thing in entries.items()]) + "\n"


def pattern(name):
    """A pattern that fits this name. Stars and question marks cannot be written, so each stands for any character."""
    return name.replace("*", "?")
