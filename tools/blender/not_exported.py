# SPDX-License-Identifier: GPL-3.0-or-later
"""What keeps a scene from being written."""


class NotExported(Exception):
    """Why a scene cannot be written, in one line."""
