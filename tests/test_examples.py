"""Every example runs as it stands, in an empty folder, and prints what a page shows of it."""

import re
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
EXAMPLES = [*sorted((ROOT / "examples").glob("*.py")), ROOT / "examples/libraries/cleanrl_ppo.py"]
PAGES = "\n".join(path.read_text("utf-8") for path in sorted((ROOT / "docs").glob("*.md")))
SHOWN = dict(
    re.findall(r"^```sh\npython examples/(\w+)\.py\n```\n\n```text\n(.*?)^```", PAGES, re.MULTILINE | re.DOTALL)
)
FIDELITY = (ROOT / "docs" / "fidelity.md").read_text("utf-8")
OPTIONS = {
    "equilibrium_layer": ["--steps", "30"],
    "fidelity": ["--quick"],
    "one_gradient": ["--updates", "2"],
    "cleanrl_ppo": ["--steps", "512", "--lanes", "4"],
}


LONG = {"fidelity", "friction_loops", "spatial_chains"}


@pytest.mark.parametrize(
    "example",
    [pytest.param(path, marks=[pytest.mark.slow] if path.stem in LONG else []) for path in EXAMPLES],
    ids=[path.stem for path in EXAMPLES],
)
def test_example_runs_without_errors_or_warnings(example, workplace, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [str(example), *OPTIONS.get(example.stem, [])])
    monkeypatch.setattr("rollingjoint.plotting.film._MOST_FRAMES", 3)
    runpy.run_path(str(example), run_name="__main__")  # a new process would import for as long as most examples run
    printed, warned = capsys.readouterr()
    assert "Warning" not in warned
    assert SHOWN.get(example.stem, printed) == printed
    if example.stem == "fidelity":
        assert printed.rstrip() in FIDELITY


def test_pages_show_what_examples_print():
    pushed = {"push_into_a_lumen", "push_into_a_tube"}
    assert set(SHOWN) == {"flexible_arm_findings", "friction_loops", "spatial_chains"} | pushed
