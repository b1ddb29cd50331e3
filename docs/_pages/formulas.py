"""Formulas of LaTeX as MathML, which browsers draw without a script or a network."""

from __future__ import annotations

import re

from latex2mathml.converter import convert

CODE = r"^```(?!math).*?^```|^````.*?^````|``[^`]+``|`[^`\n]+`"
FORMULA = re.compile(
    rf"(?P<code>{CODE})|^```math\n(?P<block>.*?)^```|\$(?P<inline>[^\s$`](?:[^$`]*[^\s$`])?)\$(?!\w)",
    re.MULTILINE | re.DOTALL,
)
MARKDOWN = str.maketrans({"*": "&#42;", "_": "&#95;", "\n": " "})


def with_formulas(text: str) -> str:
    """A page whose formulas, inline or in a block of `math`, are MathML; code stays as it is."""
    return FORMULA.sub(lambda found: found["code"] or mathml(found), text)


def mathml(found: re.Match[str]) -> str:
    """One formula; Markdown finds nothing of its own in it."""
    if found["inline"]:
        inline: str = convert(found["inline"])
        return f"<span>{inline.translate(MARKDOWN)}</span>"  # a line of Markdown that begins with math would be a block
    known = re.sub(r"(\\(?:begin|end)){aligned}", r"\1{align*}", found["block"].strip())
    block: str = convert(known, display="block")
    return f'<div class="formula">{block.translate(MARKDOWN)}</div>'
