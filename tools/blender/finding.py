# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the programs are, by the preferences of the add-on."""

import subprocess

import bpy

from . import program

MISSING = "the program ltm was not found: install it (cargo install --path tools/cli), or say in the preferences where it is"


def preferences(context):
    """The add-on's preferences; none where it runs without being installed, as in tests."""
    found = context.preferences.addons.get(__package__)
    return found.preferences if found else None


def find_program(context):
    stated = preferences(context)
    return program.find(bpy.path.abspath(stated.program) if stated and stated.program else "")


def open_mixer(operator, context, packed):
    """Starts the mixer with a container; whether it starts."""
    found = find_program(context)
    if found is None:
        operator.report({"ERROR"}, MISSING)
        return False
    try:
        subprocess.Popen([found, "view", str(packed)], stdin=subprocess.DEVNULL)
    except OSError as error:
        operator.report({"ERROR"}, f"{found} does not start: {error.strerror}")
        return False
    return True
