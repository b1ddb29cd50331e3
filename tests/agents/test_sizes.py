"""Sizes that no machine has room for: refused in one line by every command, before anything is made."""

from importlib import import_module

import pytest
import yaml

COMMANDS = [
    ("evaluate", "{} --episodes 1000000000", "--episodes = 1000000000: expected an integer from 1 to 100000"),
    ("evaluate", f"{{}} --episodes {10**30}", "from 1 to 100000"),
    ("evaluate", f"{{}} --seed {10**30}", "from 0 to 2147483648"),
    ("campaign", "{}.yaml --jobs 1000000000", "--jobs = 1000000000: expected an integer from 1 to 1024"),
    ("results.__main__", "{} --jobs 1000000000", "--jobs = 1000000000: expected an integer from 1 to 1024"),
    ("results.__main__", "{} --episodes 1000000000", "from 1 to 100000"),
    ("export", "{} --name it --episodes 1000000000", "from 1 to 100000"),
    ("tune", "--study {} --trials 1000000000", "--trials = 1000000000: expected an integer from 0 to 100000"),
    ("search.__main__", "{}.yaml --jobs 1000000000", "--jobs = 1000000000: expected an integer from 1 to 1024"),
]


@pytest.mark.parametrize(("module", "arguments", "message"), COMMANDS)
def test_a_size_beyond_its_range_is_one_line(module, arguments, message, tmp_path, capsys):
    typed = arguments.format(tmp_path / "it").split()
    assert import_module(f"agents.{module}").main(typed) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error
    assert not list(tmp_path.iterdir())


SPACE, GRADIENT = {"knots": 3}, {"gradient": {"starts": 2}}
SEARCH = {"objectives": [{"kind": "lateral_stiffness"}], "space": SPACE, "methods": GRADIENT, "budget": 4, "seeds": [1]}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"budget": 10**12}, "budget = 1000000000000: expected an integer from 1 to 10000000"),
        ({"chunk": 10**30}, "from 0 to 10000000"),
        ({"space": {"knots": 10**9 + 1}}, "an odd number from 3 to 201"),
        ({"space": SPACE | {"n_links": 10**9}}, "2 to 1000 links"),
        ({"objectives": [{"kind": "tip_rotation", "cases": 10**9}]}, "cases = 1000000000"),
        ({"methods": {"gradient": {"starts": 10**9}}}, "methods.gradient.starts = 1000000000"),
        ({"methods": {"gradient": {"memory": 10**9}}}, "methods.gradient.memory = 1000000000"),
        ({"methods": {"sqp": {"starts": 10**9}}}, "methods.sqp.starts = 1000000000"),
        ({"methods": {"random": {"batch": 10**9}}}, "methods.random.batch = 1000000000"),
        ({"methods": {"cma_es": {"population": 10**9}}}, "methods.cma_es.population = 1000000000"),
    ],
)
def test_a_search_beyond_its_ranges_is_one_line(changes, message, tmp_path, capsys):
    (tmp_path / "it.yaml").write_text(yaml.safe_dump(SEARCH | changes), "utf-8")
    main = import_module("agents.search.__main__").main
    assert main([str(tmp_path / "it.yaml"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and message in error
    assert not (tmp_path / "out").exists()
