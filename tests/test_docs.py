"""What the pages in docs/ say holds: their code runs, their links resolve, their lists are the project's."""

import ast
import itertools
import re
import tomllib
from pathlib import Path

import pytest
import yaml

from rollingjoint import Status, __version__

ROOT = Path(__file__).parent.parent
PAGES = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in sorted((ROOT / "docs").glob("*.md"))}
ROOT_PAGES = ("README.md", "CONTRIBUTING.md", "CODE_OF_CONDUCT.md", "SECURITY.md")
LINKED = {page: (ROOT / page).read_text("utf-8") for page in ROOT_PAGES} | PAGES
ARCHITECTURE, CONVERGENCE = PAGES["docs/architecture.md"], PAGES["docs/convergence.md"]

PYTHON_BLOCK = re.compile(r"^```python\n(.*?)^```\n(?:\n```text\n(.*?)^```)?", re.MULTILINE | re.DOTALL)
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
RUN_ELSEWHERE = {
    "docs/environment.md": "rj_gym/tracking/test_docs.py",
    "docs/training.md": "agents/test_docs.py",
    "docs/enter.md": "agents/test_enter.py",
}
RUN_HERE = [page for page, text in PAGES.items() if "```python" in text and page not in RUN_ELSEWHERE]
PACKAGES = sorted(
    path.parent for top in ("rollingjoint", "rj_gym", "agents") for path in (ROOT / top).rglob("__init__.py")
)
LISTING = [package for package in PACKAGES if package != ROOT / "agents"]  # whose parts docs/architecture.md lists


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN_HERE)
def test_blocks_of_a_page_run_in_order_and_print_the_text_below_them(page, workplace, capsys):
    names = {}
    for program, output in PYTHON_BLOCK.findall(PAGES[page]):
        exec(program, names)
        printed = capsys.readouterr().out
        assert output in ("", printed), program


@pytest.mark.parametrize(("page", "test"), RUN_ELSEWHERE.items())
def test_blocks_of_the_other_pages_run_in_a_test_of_their_own(page, test):
    assert Path(page).name in (ROOT / "tests" / test).read_text("utf-8")


def anchors(text):
    """Anchors that a code host gives to the headings of a page."""
    headings = re.findall(r"^#+ (.*)", FENCED.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", LINKED)
def test_relative_links_resolve(page):
    broken = []
    for link in re.findall(r"\]\((?!\w+:)([^)\s]+)\)", FENCED.sub("", LINKED[page])):
        path, _, anchor = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        if not target.exists() or (anchor and anchor not in anchors(target.read_text("utf-8"))):
            broken.append(link)
    assert broken == []


@pytest.mark.parametrize("page", LINKED)
def test_files_of_the_project_that_a_page_names_exist(page):
    tops = "rollingjoint|rj_gym|agents|tests|benchmarks|examples|configs|docs"
    named = set(re.findall(rf"(?<![\w/])((?:{tops})/[\w/.-]*\w)", LINKED[page]))
    ids = set(re.findall(r"rj_gym/\w+-v\d", LINKED[page]))
    assert sorted(path for path in named - ids if not (ROOT / path).exists()) == []


def test_every_page_is_in_the_index():
    assert {f"docs/{link}" for link in re.findall(r"\]\((\w[\w-]*\.md)\)", PAGES["docs/index.md"])} == (
        PAGES.keys() - {"docs/index.md"}
    )


def test_citation_is_of_this_version_and_of_the_papers_that_theory_names():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert (citation["version"], citation["license"]) == (__version__, project["license"])
    theory = " ".join(PAGES["docs/theory.md"].split())
    titles = [paper["title"] for paper in citation["references"]]
    assert [title for title in titles if title not in theory] == []


@pytest.mark.parametrize("package", LISTING, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_package_lists_its_modules(package):
    described = ast.get_docstring(ast.parse((package / "__init__.py").read_text("utf-8")))
    _, _, modules = described.partition("\nModules:\n")
    listed = re.findall(r"^    (\w+): \S", modules, re.MULTILINE)
    there = [path for path in package.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()]
    assert sorted(listed) == sorted(path.stem for path in there if not path.stem.startswith("__"))


def test_architecture_shows_every_folder_of_the_packages():
    tree = ARCHITECTURE.split("```text\n", 1)[1].split("```", 1)[0]
    shown = set(re.findall(r"(\w+)/", tree))
    assert {package.name for package in PACKAGES} <= shown
    commands = {path.stem for path in (ROOT / "agents").glob("[a-z]*.py")}
    assert commands <= set(re.findall(r"\w+", tree))


def test_architecture_shows_the_layers_that_are_enforced():
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    inside = next(contract for contract in contracts if contract.get("containers") == ["rollingjoint"])
    tree = ARCHITECTURE.split("\nrollingjoint/", 1)[1].split("\nrj_gym/", 1)[0].splitlines()[1:]
    lines = [re.split(r"   +", line.strip())[0].replace("/", "").split() for line in tree]
    place = {name: number for number, names in enumerate(lines) for name in names}
    layers = [[place[name] for name in layer.split(" | ")] for layer in inside["layers"] if layer != "__main__"]
    for above, below in itertools.pairwise(layers):
        assert max(above) <= min(below)


def test_convergence_table_has_every_status_and_counts_every_solve():
    first = CONVERGENCE[: CONVERGENCE.index("## ")]
    header, _, *rows = [line.strip("|").split("|") for line in first.splitlines() if line.startswith("|")]
    statuses = [status for status in Status if status not in (Status.NO_ROOM, Status.PASSED_THROUGH)]  # among walls
    assert [name.strip() for name in header[3:-1]] == [status.name.lower().replace("_", " ") for status in statuses]
    counts = [[int(cell) for cell in row[3:-1]] for row in rows]
    assert f"{sum(map(sum, counts))} solves" in CONVERGENCE


def test_tables_of_settings_are_those_of_the_annotations(monkeypatch):
    """`python docs/_pages/settings.py` writes them."""
    monkeypatch.syspath_prepend(ROOT / "docs/_pages")
    import settings

    for page in settings.TABLES:
        assert settings.with_tables(page, PAGES[f"docs/{page}"]) == PAGES[f"docs/{page}"]


def test_theory_has_the_sections_that_the_code_refers_to():
    sources = [
        path.read_text("utf-8")
        for top in ("rollingjoint", "rj_gym", "agents", "tests")
        for path in (ROOT / top).rglob("*.py")
    ]
    referred = {
        int(number)
        for text in [*sources, *PAGES.values()]
        for group in re.findall(r"docs/theory\.md, sections? ([\d, and]+)", text)
        for number in re.findall(r"\d+", group)
    }
    numbered = {int(number) for number in re.findall(r"^## (\d+)\. ", PAGES["docs/theory.md"], re.MULTILINE)}
    assert referred and referred <= numbered
