"""Images to and from OpenEXR's own module (``pip install OpenEXR``).

python openexr_images.py room.ltc lights.exr     a layer for each light, as the scene lights it, and RGB: all of them
python openexr_images.py lights.exr room.ltc     and back: each layer is a light
"""

import sys

import ltm
import numpy as np
import OpenEXR

HEADER = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}


def write_layers(m: ltm.Matrix, path: str) -> None:
    """Writes the image of each light as a layer by its name, and that of all lights as RGB: float32, linear Rec. 709."""
    weights = np.zeros((len(m.lights), m.shape[3], 3), np.float32)
    for of_light, light in zip(weights, m.lights, strict=True):
        of_light[light.columns] = m.scene_weights[light.columns]
    images = m.relight(weights)
    # A dot in a layer's name would begin that of a channel.
    layers = {light.name.replace(".", "_"): image for light, image in zip(m.lights, images, strict=True)}
    with OpenEXR.File(HEADER, {"RGB": m.relight(m.scene_weights), **layers}) as file:
        file.write(path)


def read_layers(path: str) -> tuple[list[str], np.ndarray]:
    """The names of a file's layers of three channels but for RGB, and their images (layers, height, width, 3)."""
    with OpenEXR.File(path) as file:
        layers = {name: channel.pixels for name, channel in file.channels().items() if name != "RGB"}
    layers = {name: pixels for name, pixels in layers.items() if pixels.ndim == 3 and pixels.shape[2] == 3}
    return list(layers), np.array(list(layers.values()), np.float32)


def main() -> None:
    source, target = sys.argv[1:3]
    if source.endswith(".exr"):
        names, images = read_layers(source)
        print(ltm.pack(images, target, lights=names))
    else:
        with ltm.open(source) as m:
            write_layers(m, target)


if __name__ == "__main__":
    main()
