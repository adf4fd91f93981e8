"""The help as an image."""

import numpy as np
from jaxtyping import Float32
from PIL import Image, ImageDraw, ImageFont

from prtnet.view.state import KEYS

Array = np.ndarray

SIZE = 15  # pixels, of a screen without scaling
INK, PAPER = (255, 255, 255, 255), (20, 20, 24, 200)


def help_image(scale: float = 1.0) -> Float32[Array, "h w 4"]:
    """The keys and what they do, RGBA in [0, 1], encoded as a screen shows it."""
    font = ImageFont.load_default(SIZE * scale)
    line, indent, edge = round(1.5 * SIZE * scale), round(6 * SIZE * scale), round(SIZE * scale)
    width = round(max(font.getlength(words) for _, words in KEYS)) + indent + 2 * edge
    image = Image.new("RGBA", (width, line * len(KEYS) + 2 * edge), PAPER)
    draw = ImageDraw.Draw(image)
    for row, (key, words) in enumerate(KEYS):
        draw.text((edge, edge + row * line), key, INK, font)
        draw.text((edge + indent, edge + row * line), words, INK, font)
    return np.asarray(image, np.float32) / 255
