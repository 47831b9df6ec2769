"""Light transport matrices: trace a scene once, compress the matrix, relight it at once.

A scene under n basis lights is a matrix T with one row for each pixel and colour channel and one column for each basis
light (a lamp, a texel of an area light or of an environment). The image under any lighting is one product, ``T @ w``.

>>> import ltm
>>> with ltm.open("room.ltc") as m:
...     image = m.relight({"lamp *": 2.0, "sky": [0.2, 0.3, 0.5]})   # float32 (height, width, 3)
...     desk = m[100:200, 50:150, :, "desk"]                          # one column of some pixels
...     gradient = m.adjoint(image)                                   # Tᵀx: float32 (columns, 3)

Images are linear Rec. 709, rows from the top. A column's weight is in the unit of its light (see ``Light.unit``).
"""

from ._daylight import DaylightYear, Glare, GlareSource, glare
from ._lights import Light, Lights
from ._ltm import BUILT_IN_SCENES, DamagedError, NoGpuError, __version__
from ._make import (
    BuiltIn,
    Estimate,
    PackReport,
    RenderReport,
    Verified,
    info,
    merge,
    pack,
    render,
    render_live,
    verify,
    write,
    write_basis,
)
from ._matrix import Block, Blocks, Gpu, Look, Matrix, gpu, open

__all__ = [
    "BUILT_IN_SCENES",
    "Block",
    "Blocks",
    "BuiltIn",
    "DamagedError",
    "DaylightYear",
    "Estimate",
    "Glare",
    "GlareSource",
    "Gpu",
    "Light",
    "Lights",
    "Look",
    "Matrix",
    "NoGpuError",
    "PackReport",
    "RenderReport",
    "Verified",
    "__version__",
    "glare",
    "gpu",
    "info",
    "merge",
    "open",
    "pack",
    "render",
    "render_live",
    "verify",
    "write",
    "write_basis",
]
