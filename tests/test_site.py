"""The documentation site: its pages are complete and built without a warning, its links resolve, its notebooks run."""

import importlib
import inspect
import os
import re
import shutil
import subprocess
import sys
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import nbformat
import pytest
from nbclient import NotebookClient

from rj_gym.registry import TABLE
from tests.conftest import sources_first

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs" / "_pages"))
import environments  # noqa: E402
import formulas  # noqa: E402
import math_font  # noqa: E402
import reference  # noqa: E402
import repository  # noqa: E402

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
NAV = re.findall(r"[\w./-]+\.md$", (ROOT / "mkdocs.yml").read_text("utf-8"), re.MULTILINE)
# A command, what `rollingjoint` has of it, and a room that may still change.
NOT_FOR_USERS = {"rollingjoint.cli", "rollingjoint.load", "rollingjoint.surroundings", "rollingjoint.estimate"}


def without_docstring(name, value):
    """Names that have none: a class or function, and public methods and properties of a class."""
    if not (inspect.isclass(value) or inspect.isroutine(value) or isinstance(value, property)):
        return []
    inside = vars(value).items() if inspect.isclass(value) else ()
    found = [each for key, member in inside if key[0] != "_" for each in without_docstring(f"{name}.{key}", member)]
    documented = inspect.getdoc(getattr(value, "__func__", value)) or ""
    made_up = f"{name.rpartition('.')[2]}("  # how the docstring begins that a dataclass without one is given
    return found if documented and not documented.startswith(made_up) else [name, *found]


@pytest.mark.parametrize("path", reference.MODULES)
def test_every_public_name_has_a_docstring(path):
    module = importlib.import_module(path)
    names = reference.public_names(module)
    assert names and inspect.getdoc(module)
    assert [each for name in names for each in without_docstring(name, getattr(module, name))] == []


def test_reference_has_every_package_that_says_what_it_offers():
    tops = ("rollingjoint", "rj_gym", "agents")
    inits = [path for top in tops for path in (ROOT / top).rglob("__init__.py")]
    offer = [path.parent.relative_to(ROOT) for path in inits if "__all__ =" in path.read_text("utf-8")]
    offering = {path.as_posix().replace("/", ".") for path in offer}
    assert offering - NOT_FOR_USERS <= set(reference.MODULES)


def test_menu_has_every_page():
    pages = {page for page in repository.pages() if page.endswith(".md") and not page.startswith("repository/")}
    pages |= {"environments/index.md", *(f"environments/{name}" for name in environments.PAGES.values())}
    assert sorted((pages | set(reference.pages())) - set(NAV)) == []


@pytest.mark.parametrize("row", TABLE, ids=lambda row: row.env_id)
def test_page_of_an_environment_has_its_spaces_reward_arguments_versions_and_settings(row):
    page = environments.page(row)
    wanted = ["Action space", "Observation space", "Reward", "Start", "Episode end", "Info", "Arguments"]
    wanted.append("Version history")
    assert [heading for heading in re.findall(r"^## (.*)", page, re.MULTILINE) if heading in wanted] == wanted
    assert f'gymnasium.make("{row.env_id}")' in page and "| action space | `Box(" in page
    picture = ROOT / "docs" / "images" / environments.moving(row)
    assert picture.exists() and f"![{environments.caption(row)}](../images/{picture.name})" in page
    settings = environments.every_setting(environments.rj_gym.settings_of(row.env_id)())
    assert [each.name for each in settings if not each.meaning] == []


def test_links_to_files_outside_the_pages_go_to_pages_of_the_site():
    text = "[a](../examples/fidelity.py) [b](physics.md#a) [c](../README.md) [d](https://a.b/c) ![](images/demo.gif)"
    assert repository.moved(text, "docs/index.md") == (
        "[a](repository/examples/fidelity.py.md) [b](physics.md#a) [c](repository/README.md) [d](https://a.b/c) "
        "![](images/demo.gif)"
    )
    assert repository.moved("[a](docs/cad.md) [b](LICENSE)", "README.md") == "[a](../cad.md) [b](LICENSE.md)"


def test_formulas_become_mathml_and_code_stays():
    text = "price `$a$`, mass $m_1*$\n\n```math\nx^2\n```\n\n```sh\necho $HOME $PATH\n```\n"
    page = formulas.with_formulas(text)
    assert page.count("<math") == 2 and "`$a$`" in page and "echo $HOME $PATH" in page and "*" not in page
    assert '<div class="formula"><math' in page and "<msup><mi>x</mi><mn>2</mn></msup>" in page


def test_columns_of_a_formula_are_a_table():
    page = formulas.with_formulas("```math\n\\begin{aligned}\na &= b \\\\\nc &= d\n\\end{aligned}\n```\n")
    assert page.count("<mtr>") == 2 and page.count("<mtd ") == 4 and "&</mi>" not in page


def test_the_font_of_formulas_has_its_characters():
    font_tools = pytest.importorskip("fontTools.ttLib", reason="comes with matplotlib")
    pytest.importorskip("brotli", reason="fonttools reads WOFF2 with it")
    font = font_tools.TTFont(math_font.FONT)
    assert {chr(code) for code in font.getBestCmap()} >= math_font.CHARACTERS
    assert "MATH" in font and font["name"].getDebugName(1) == math_font.NAME and math_font.FONT.stat().st_size < 100_000


def code(notebook):
    return [cell for cell in nbformat.read(notebook, 4).cells if cell.cell_type == "code"]


def printed(cell):
    return "".join(output.text for output in cell.outputs if output.output_type == "stream")


def test_physics_notebook_prints_what_it_shows(capsys):
    names = {}
    for cell in code(ROOT / "examples/notebooks/physics_in_five_minutes.ipynb"):
        exec(re.sub(r"^%.*\n", "", cell.source), names)
        assert capsys.readouterr().out == printed(cell)
    names["pyplot"].close("all")


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
def test_notebook_runs(path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", sources_first()["PYTHONPATH"])
    shown = nbformat.read(path, 4)
    done = NotebookClient(nbformat.read(path, 4), timeout=300, resources={"metadata": {"path": str(ROOT)}}).execute()
    last, last_shown = ([cell for cell in each.cells if cell.cell_type == "code"][-1] for each in (done, shown))
    assert printed(last) == printed(last_shown)


class Links(HTMLParser):
    """Links and anchors of a page."""

    def __init__(self, page):
        super().__init__()
        self.links, self.anchors = [], {""}
        self.feed(page.read_text("utf-8"))

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.anchors |= {given[key] for key in ("id", "name") if given.get(key)}
        self.links += [given[key] for key in ("href", "src") if given.get(key)]


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    project = tmp_path_factory.mktemp("site")
    config = (ROOT / "mkdocs.yml").read_text("utf-8").replace("docs_dir: build/docs", "docs_dir: docs")
    (project / "mkdocs.yml").write_text(config.replace("paths: [.]", f"paths: [{ROOT}]"), "utf-8")
    run = {"env": sources_first(), "capture_output": True, "text": True}
    done = subprocess.run([sys.executable, "docs/_pages"], cwd=ROOT, **run)
    assert done.returncode == 0 and "WARNING" not in done.stderr, done.stderr
    shutil.copytree(ROOT / "build" / "docs", project / "docs")
    done = subprocess.run([sys.executable, "-m", "zensical", "build", "--strict"], cwd=project, **run)
    assert done.returncode == 0, done.stdout + done.stderr
    return {path: Links(path) for path in (project / "site").rglob("*.html") if path.name != "404.html"}


@pytest.mark.slow
def test_every_link_of_the_site_resolves(site):
    broken = []
    for page, found in site.items():
        for link in found.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                continue
            target = Path(os.path.normpath(page.parent / unquote(parts.path))) if parts.path else page
            there = target in site and unquote(parts.fragment) in site[target].anchors
            if not (there if target.suffix == ".html" else target.exists()):
                broken.append(f"{page.name}: {link}")
    assert broken == []


@pytest.mark.slow
def test_formulas_have_no_character_that_their_font_lacks(site):
    formulas_of = [re.findall(r"<math.*?</math>", page.read_text("utf-8"), re.DOTALL) for page in site]
    letters = {letter for found in formulas_of for each in found for letter in unescape(re.sub("<.*?>", "", each))}
    assert len(letters) > 100 and "".join(sorted(letters - math_font.CHARACTERS - {"\n"})) == ""


@pytest.mark.slow
def test_search_and_formulas_work_in_a_browser_from_disk(site, browser):
    (theory,) = (page for page in site if page.name == "theory.html")
    window = browser.new_page(viewport={"width": 390, "height": 800})
    failed = []
    window.on("requestfailed", lambda request: failed.append(request.url))
    window.goto(theory.as_uri())
    assert window.evaluate("document.fonts.load('16px \"Rolling-joint Formulas\"').then(found => found.length)") == 1
    assert window.evaluate("document.scrollingElement.scrollWidth <= innerWidth")
    window.keyboard.press("Control+k")
    window.keyboard.type("own mechanism")
    window.get_by_role("link", name="Mechanism files").first.wait_for(timeout=20_000)
    assert failed == []
    window.close()


@pytest.mark.slow
def test_reference_shows_every_public_name(site):
    anchors = {page.stem: found.anchors for page, found in site.items() if page.parent.name == "reference"}
    for path in reference.MODULES:
        module = importlib.import_module(path)
        names = [name for name in reference.public_names(module) if not inspect.ismodule(getattr(module, name))]
        wanted = {f"{path}.{name}" for name in names}
        assert sorted(wanted - anchors[path]) == []


@pytest.mark.slow
def test_pages_load_nothing_from_elsewhere(site):
    loaded = r'<(?:script|img|iframe)[^>]* src="(?:https?:)?//|<link[^>]* rel="stylesheet"[^>]* href="(?:https?:)?//'
    assert [page.name for page in site if re.search(loaded, page.read_text("utf-8"))] == []
