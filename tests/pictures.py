"""The pictures of the gallery: what `make demos` drew, in 256 colours. ``make pictures``."""

from pathlib import Path

from PIL import Image

ROOT = Path(__file__).parents[1]
DRAWN = ROOT / "out" / "demos"
GALLERY = ROOT / "demos" / "pictures"
SOURCES = {"01_paper_example": "01_D1.0/settling", "overview": "01_overview"}
"""Demos that draw several pictures: the one for the gallery."""


def main() -> None:
    """Renew every picture that has been drawn."""
    for old in sorted(GALLERY.glob("*.png")):
        source = DRAWN / f"{SOURCES.get(old.stem, old.stem)}.png"
        if source.exists():
            small(source, old)
            print(old.relative_to(ROOT), f"{old.stat().st_size / 1000:.0f} kB")


def small(source: Path, target: Path) -> None:
    """The picture with a palette: a third of the bytes, no difference to see."""
    with Image.open(source) as picture:
        palette = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    palette.save(target, optimize=True)


if __name__ == "__main__":
    main()
