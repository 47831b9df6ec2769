# SPDX-License-Identifier: GPL-3.0-or-later
"""Render › Light transport (ltm): the open scene rendered once, all its lights mixed at once."""

import bpy

from . import cycles_operators, interface, operators

CLASSES = operators.CLASSES + cycles_operators.CLASSES + interface.CLASSES


def register():
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    interface.register()


def unregister():
    interface.unregister()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
