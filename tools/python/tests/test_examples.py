"""The examples: the notebook, and images of OpenEXR's module."""

import runpy
from pathlib import Path

import ltm
import numpy as np
import pytest

EXAMPLES = Path(__file__).parent.parent / "examples"

#: What a person does in the notebook: moves a slider, and looks.
MOVES = """
before = bytes(picture.value)
assert before.startswith(b"\\x89PNG")
sliders[0].value = -6.0
dimmed = bytes(picture.value)
assert dimmed != before
sliders[0].value = 0.0
assert bytes(picture.value) == before
for slider in sliders[1:]:
    slider.value = -6.0
weights, first = np.zeros_like(m.scene_weights), next(iter(parts.values()))
weights[first] = m.scene_weights[first]
assert bytes(picture.value) == png(m.relight(weights)) != before
"""


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning", "ignore::RuntimeWarning")
@pytest.mark.parametrize("own", [True, False])
def test_the_notebook_mixes(container_path, own, monkeypatch, tmp_path):
    nbclient = pytest.importorskip("nbclient")
    nbformat = pytest.importorskip("nbformat")
    pytest.importorskip("ipywidgets")
    pytest.importorskip("ipykernel")
    if own:
        monkeypatch.setenv("LTM_CONTAINER", str(container_path))
    else:
        monkeypatch.delenv("LTM_CONTAINER", raising=False)
    notebook = nbformat.read(EXAMPLES / "mix.ipynb", 4)
    nbformat.validate(notebook)
    notebook.cells.append(nbformat.v4.new_code_cell(MOVES))
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": tmp_path}}).execute()
    # Its last cell shows the mixer.
    shown = [output.data for output in notebook.cells[-2].outputs if "data" in output]
    assert any("application/vnd.jupyter.widget-view+json" in data for data in shown)


def test_images_go_to_openexr_and_back(container_path, tmp_path):
    OpenEXR = pytest.importorskip("OpenEXR")
    example = runpy.run_path(str(EXAMPLES / "openexr_images.py"))
    path = str(tmp_path / "lights.exr")
    with ltm.open(container_path) as m:
        example["write_layers"](m, path)
        names, images = example["read_layers"](path)
        assert sorted(names) == sorted(m.lights.keys())
        for name, image in zip(names, images, strict=True):
            np.testing.assert_array_equal(image, m.relight({name: 1.0}))
        with OpenEXR.File(path) as file:
            np.testing.assert_array_equal(file.channels()["RGB"].pixels, m.relight(m.scene_weights))
        ltm.pack(images, tmp_path / "again.ltc", lights=names, target="60dB")
        with ltm.open(tmp_path / "again.ltc") as again:
            wanted = m.relight({"desk": 1.0, "sky": 0.5})
            lost = again.relight({"desk": 1.0, "sky": 0.5}) - wanted
            # What 60 dB leaves.
            assert np.linalg.norm(lost) < 0.01 * np.linalg.norm(wanted)
