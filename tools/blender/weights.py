# SPDX-License-Identifier: GPL-3.0-or-later
"""Weights of lights, and strengths that follow them."""

# Custom property of what has a texture for a colour: its strength when it was exported, which is what weights are relative to.
EXPORTED = "ltm_exported_strength"


def differs(weight, before):
    """Whether two weights are not the same but for rounding."""
    largest = max(map(abs, [*weight, *before]))
    return any(abs(w - b) > 1e-5 * largest for w, b in zip(weight, before))


def rescale(owner, strength, weight, before):
    """Sets the strength of a material or world by the factor from the weight it was exported with, however often; whether it changed."""
    exported = owner.get(EXPORTED, strength.default_value)
    wanted = exported * sum(weight) / max(sum(before), 1e-12)
    if not differs([wanted], [strength.default_value]):
        return False
    owner[EXPORTED] = exported
    strength.default_value = wanted
    return True


def begin_anew(owners):
    """Forgets strengths of an earlier export: this one exports those of today."""
    for owner in owners:
        if EXPORTED in owner:
            del owner[EXPORTED]
