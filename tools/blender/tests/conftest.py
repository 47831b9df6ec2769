# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-on registered as Blender would, without a window; and a room of our own making.

    pip install bpy==4.2.0 numpy pytest     # wants the Python of that Blender, 3.11
    cargo build -p ltm-cli && python -m pytest tools/blender

The program is the one that LTM names, else the newest in `target`.
"""

import importlib.util
import os
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1]

if importlib.util.find_spec("bpy") is None:
    collect_ignore_glob = ["test_*.py"]


def load_add_on():
    """The folder as the package `ltm`, whatever it is called."""
    place = {"submodule_search_locations": [str(FOLDER)]}
    spec = importlib.util.spec_from_file_location("ltm", FOLDER / "__init__.py", **place)
    package = importlib.util.module_from_spec(spec)
    sys.modules["ltm"] = package
    spec.loader.exec_module(package)
    return package


@pytest.fixture
def add_on():
    """The add-on, registered in a new, empty file."""
    import bpy

    package = sys.modules.get("ltm") or load_add_on()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    package.register()
    yield package
    package.unregister()


@pytest.fixture(scope="session")
def program():
    """The program ltm, and the variable by which the add-on finds it."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", FOLDER.parents[1] / "target"))
    built = [path for path in (target / "release" / "ltm", target / "debug" / "ltm") if path.is_file()]
    found = os.environ.get("LTM") or (built and str(max(built, key=lambda path: path.stat().st_mtime)))
    if not found:
        pytest.skip("the program ltm is not built")
    os.environ["LTM"] = found
    return found


@pytest.fixture
def scene(add_on, tmp_path):
    """A new file with a room and a camera before its open side, and no light."""
    import bpy
    from room import furnish

    scene = bpy.context.scene
    scene.ltm.folder = str(tmp_path)
    furnish(scene)
    return scene


def pytest_sessionfinish(session, exitstatus):
    session.config.exit_status = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config):
    """Ends without Blender's own end: as a module it faults there once its glTF exporter has run, with or without us."""
    if "bpy" in sys.modules:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(getattr(config, "exit_status", 1))
