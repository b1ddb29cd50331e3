"""Mutants of the physics and of environments: what is broken, what is drawn, and what becomes of them."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCE = '''"""A module - with a docstring."""

LEFT = 1 - 2


def area(a: "1 + 1", b):
    """The area a * b, κ."""
    total = 0.5 * (a) - -b  # κ: letters of two bytes
    for i in range(2, b + 1):
        total += a[i]
    if a <= b and (total > 0.0) == True:
        raise ValueError(f"{a - b}" + "κ")
    return total
'''
BROKEN = {
    ("operator", "total = 0.5 / (a) - -b  # κ: letters of two bytes"),
    ("operator", "total = 0.5 * (a) + -b  # κ: letters of two bytes"),
    ("operator", "for i in range(2, b - 1):"),
    ("operator", "total -= a[i]"),
    ("sign", "total = 0.5 * (a) - b  # κ: letters of two bytes"),
    ("constant", "total = 1.0 * (a) - -b  # κ: letters of two bytes"),
    ("constant", "if a <= b and (total > 1.0) == True:"),
    ("comparison", "if a >= b and (total > 0.0) == True:"),
    ("comparison", "if a <= b and (total < 0.0) == True:"),
    ("comparison", "if a <= b and (total > 0.0) != True:"),
    ("off by one", "for i in range(3, b + 1):"),
    ("off by one", "for i in range(2, b + 2):"),
    ("off by one", "for i in range(2, b + 1 - 1):"),
}


@pytest.fixture(autouse=True)
def benchmarks_on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))


def test_bodies_of_functions_are_broken_and_nothing_else_is():
    from mutation_sites import sites_of

    assert {(site.kind, site.mutant) for site in sites_of("area.py", SOURCE)} == BROKEN


@pytest.mark.slow
@pytest.mark.parametrize("subject", ["physics", "spatial", "environments"])
def test_every_mutant_of_a_draw_is_another_program_and_one_change(subject):
    import mutants

    drawn = mutants.draw(subject, 100, 3)
    for site in drawn:
        source = (ROOT / site.file).read_text("utf-8")
        mutant = site.mutated(source)
        assert ast.dump(ast.parse(mutant)) != ast.dump(ast.parse(source))
        before, after = source.splitlines(), mutant.splitlines()
        assert [line for line, pair in enumerate(zip(before, after, strict=True), 1) if pair[0] != pair[1]] == [
            site.line
        ]
        assert (before[site.line - 1].strip(), after[site.line - 1].strip()) == (site.original, site.mutant)
    assert drawn == mutants.draw(subject, 100, 3) != mutants.draw(subject, 100, 4)
    if subject == "physics":  # which has enough of every kind
        counts = {kind: sum(site.kind == kind for site in drawn) for kind in mutants.KINDS}
        assert counts == dict.fromkeys(mutants.KINDS, 20)


def test_the_tests_of_every_stage_exist():
    import mutants

    for stage in (mutants.FIRST, mutants.SECOND):
        assert list(stage)[-1] == ""  # for every file
        assert [path for paths in stage.values() for path in paths if not (ROOT / path).exists()] == []


def test_mutants_that_are_called_equivalent_are_mutants_of_today():
    import mutants

    patterns = [pattern for subject in mutants.SOURCES.values() for pattern in subject]
    files = [path for pattern in patterns for path in ROOT.glob(pattern)]
    sites = [site for path in files for site in mutants.sites_of(path.name, path.read_text("utf-8"))]
    listed = mutants.equivalents()
    assert listed.keys() <= {(site.file, site.original, site.mutant) for site in sites}
    assert all(len(because) > 20 for because in listed.values())


@pytest.mark.slow
def test_a_wrong_formula_is_killed_and_a_mutant_that_nobody_tests_survives(monkeypatch, tmp_path):
    import mutants

    path = ROOT / "rollingjoint/profile.py"
    sites = mutants.sites_of("rollingjoint/profile.py", path.read_text("utf-8"))
    quick = ["tests/rollingjoint/test_profile.py"]
    workplace = mutants.Workplace(tmp_path)
    wrong = next(site for site in sites if site.kind == "sign" and "cumsum" in site.original)
    monkeypatch.setattr(mutants, "stages_of", lambda file: [quick])
    workplace.check(set(quick))
    verdict = workplace.judge(wrong)
    assert verdict.outcome == "killed" and verdict.by.startswith("tests/rollingjoint/test_profile.py::")
    assert (workplace.tree / wrong.file).read_bytes() == path.read_bytes()
    monkeypatch.setattr(workplace, "_first_failure", lambda tests, patience, cache=None: "")
    survived = workplace.judge(wrong)
    assert mutants.summary([verdict, verdict, survived]) == "2 killed, 1 survived, 0 equivalent: score 67%"
