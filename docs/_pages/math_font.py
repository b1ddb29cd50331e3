"""The font of formulas on the site, with the characters that pages use, or may: a subset of Latin Modern Math.

Run, with fonttools and brotli: python docs/_pages/math_font.py latinmodern-math.otf
The font is one of GUST (https://www.gust.org.pl/projects/e-foundry/lm-math); assets/formulas.txt has its licence.
"""

from __future__ import annotations

import string
import sys
from pathlib import Path

FONT = Path(__file__).parents[1] / "assets" / "formulas.woff2"
NAME = "Rolling-joint Formulas"  # another one than the original's, as its licence asks
OPERATORS = "¬°±·×÷˙¯‖…′″‴⁄ℓℝ←↑→↓↔↦⇐⇒⇔∀∂∃∅∇∈∉∏∑−∓∗∘∙√∝∞∠∥∧∨∩∪∫∮∼≈≠≡≤≥≪≫⊂⊆⊕⊗⊥⋅⋮⋯⌈⌉⌊⌋⟂⟨⟩⟵⟶"
GREEK = "".join(map(chr, [*range(0x391, 0x3A2), *range(0x3A3, 0x3AA), *range(0x3B1, 0x3CA)])) + "ϑϕϖϱϵ"
ACCENTS = "\u0302\u0303\u0304\u0305\u0307\u0308\u030c\u20d7"
PLAIN = {*string.digits, *string.ascii_letters, *string.punctuation, " ", "\u00a0", *OPERATORS, *GREEK, *ACCENTS}


def italic(letter: str) -> str:
    """The letter as browsers draw it where it stands alone; the letter itself where there is no such one."""
    first = {"A": 0x1D434, "a": 0x1D44E, "Α": 0x1D6E2, "α": 0x1D6FC}
    if letter == "h":
        return "ℎ"
    start = next((each for each in reversed(first) if each <= letter <= chr(ord(each) + 25)), None)
    return letter if start is None else chr(first[start] + ord(letter) - ord(start))


CHARACTERS = PLAIN | {italic(letter) for letter in PLAIN} | set("𝜕𝜖𝜗𝜙𝜚𝜛ıȷ")


def main(original: str) -> None:
    """Write FONT."""
    from fontTools.subset import Options, Subsetter, load_font, save_font

    options = Options(flavor="woff2", hinting=False, layout_features=["*"], drop_tables=["FFTM"])
    font = load_font(original, options)
    subsetter = Subsetter(options)
    subsetter.populate(unicodes=map(ord, CHARACTERS))
    subsetter.subset(font)
    for record in font["name"].names:
        if record.nameID in (1, 3, 4, 6, 16):
            record.string = NAME.replace(" ", "-") if record.nameID == 6 else NAME
    save_font(font, str(FONT), options)


if __name__ == "__main__":
    main(sys.argv[1])
