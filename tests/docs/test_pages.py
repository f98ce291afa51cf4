"""The README, the site and the stored results agree; every page leads on, and no link leads nowhere."""

import importlib
import inspect
import json
import re
import subprocess
import sys
import tomllib
import zipfile
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from browser import needs_browser, opened, violations
from click.testing import CliRunner

from frischid import LogMap, PDController
from frischid.cli import main

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
README = ROOT / "README.md"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [README, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", ROOT / "paper" / "paper.md", *PAGES]


def name_of(path):
    return str(path.relative_to(ROOT))


def text_of(path):
    return path.read_text(encoding="utf-8")


def shown(page):
    """Text of a page as a reader sees it, without the marks of figures."""
    return re.sub(r"<!-- figure: \w+ -->(.*?)<!-- end -->", r"\1", text_of(page))


def script(name):
    if str(DOCS) not in sys.path:
        sys.path.insert(0, str(DOCS))  # the scripts import each other
    return importlib.import_module(name)


def test_the_readme_is_short():
    assert len(text_of(README).splitlines()) <= 150


def test_the_readme_has_two_commands():
    """`.ci/run` takes the installation and the tests from here, word for word."""
    assert len(re.findall(r"^python3 -m venv .venv .*$", text_of(README), flags=re.MULTILINE)) == 2


def test_tables_show_the_stored_results():
    tables = script("tables")
    pages = [*tables.pages()]
    assert {README, ROOT / "paper" / "paper.md", *(DOCS / "benchmarks").glob("*.md")} <= {*pages}
    for page in pages:
        assert text_of(page) == tables.filled(page), f"{name_of(page)}: run python docs/tables.py"
        assert not re.search("^ *<!-- figure: ", text_of(page), flags=re.MULTILINE), "no line begins with a figure"


def test_every_stored_result_is_on_a_page_and_every_table_is_used(monkeypatch):
    tables, parts = script("tables"), script("table_parts")
    marks = {name for page in tables.pages() for name in re.findall(r"<!-- (?:table|figure): (\w+) -->", text_of(page))}
    assert {*tables.TABLES, *tables.FIGURES} <= marks
    used = {made.result for made in tables.TABLES.values()} | {"six_robots"}
    stored = parts.data
    monkeypatch.setattr(parts, "data", lambda name="six_robots": used.add(name) or stored(name))
    assert all(make() for make in tables.FIGURES.values())
    assert {path.stem for path in (DOCS / "data").glob("*.json")} <= used
    for made in tables.TABLES.values():
        assert (ROOT / "benchmarks" / f"{made.script}.py").exists()


@pytest.mark.parametrize("folder", ["benchmarks", "robots"])
def test_no_table_of_figures_is_typed_by_hand(folder):
    for page in sorted((DOCS / folder).glob("*.md")):
        rest = re.sub(r"<!-- table: \w+ -->.*?<!-- end -->", "", text_of(page), flags=re.DOTALL)
        assert not re.findall(r"^\|.*\d.*$", rest, flags=re.MULTILINE), f"{page.name}: make the table from JSON"


def test_the_pages_on_bands_say_what_the_table_of_trust_holds():
    share, pairs = re.search(
        r"at least (\d+ %).* on (\d+ of \d+) pairs", script("tables_of_robots").band_in_words()
    ).groups()
    for name in ("guides/identify.md", "understand/noise-floor.md"):
        words = " ".join(shown(DOCS / name).split())
        assert f"the band holds at least {share} on {pairs} pairs of logs" in words


def test_the_table_holds_every_robot_of_the_script(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    from six_robots import ROBOTS

    stored = json.loads(text_of(DOCS / "data" / "six_robots.json"))
    assert [row["key"] for row in stored["rows"]] == [robot.key for robot in ROBOTS]
    for row in stored["rows"]:
        assert f"| {row['identified']:.3f} | **{row['improved']:.3f}** |" in text_of(README)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_page_ends_with_a_next_step(page):
    last = text_of(page).strip().split("\n\n")[-1]
    assert last.startswith("**Next:**"), "end the page with **Next:** and a link"
    assert "](" in last


@pytest.mark.parametrize("page", TEXTS, ids=name_of)
def test_no_paragraph_ends_a_list_by_a_short_indent(page):
    """The site's Markdown wants four spaces; after fewer, all further items would be one paragraph."""
    assert not re.search(r"\n\n {1,3}\S", text_of(page))


@pytest.mark.parametrize("page", TEXTS, ids=name_of)
def test_relative_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", text_of(page)):
        if not target.startswith(("http", "#")):
            assert (page.parent / target.split("#")[0]).exists(), target


def test_links_to_other_sites_have_the_form_of_an_address():
    """Whether the sites answer is the question of .github/workflows/links.yml."""
    found = {link for page in TEXTS for link in re.findall(r"\]\((https?:[^)]*)\)", text_of(page))}
    found |= set(re.findall(r"url = \{([^}]+)\}", text_of(ROOT / "paper" / "paper.bib")))
    assert len(found) > 10
    for link in found:
        parts = urlsplit(link)
        assert parts.scheme == "https", link
        assert re.fullmatch(r"(?:[a-z0-9-]+\.)+[a-z]{2,}", parts.netloc), link
        assert not re.search(r"[\s<>{}\"'`]|[.,;:]$", link), link
        if parts.netloc == "github.com":
            assert re.fullmatch(r"/[\w.-]+/[\w.-]+(?:/(?:tree|blob)/[\w./-]+)?", parts.path), link


def test_the_trail_of_one_log_names_functions_that_exist():
    """docs/architecture.md leads a reader of the code from the file to the report."""
    rows = re.findall(r"^\| \d+ \| .*$", text_of(DOCS / "architecture.md"), flags=re.MULTILINE)
    named = [pair for row in rows for pair in re.findall(r"`([\w.]+)` in `(\w+/\w+)\.py`", row)]
    assert len(named) >= len(rows) > 10
    for function, path in named:
        found = importlib.import_module(f"frischid.{path.replace('/', '.')}")
        for part in function.split("."):
            found = getattr(found, part)
        assert callable(found)


def test_every_page_is_in_the_navigation():
    listed = set(re.findall(r"[\w/-]+\.md", text_of(ROOT / "mkdocs.yml")))
    assert listed == {page.relative_to(DOCS).as_posix() for page in PAGES}


NAMED = re.compile(r"`(\w+)(?:\.\w+)?` (?:in|of)?\s*\(?`((?:\w+/)+\w+\.py)`")


@pytest.mark.parametrize("page", [ROOT / "CONTRIBUTING.md", DOCS / "architecture.md"], ids=lambda page: page.stem)
def test_names_that_the_page_finds_in_a_file_are_there(page):
    """A recipe had sent readers to the report for the table of estimators, which had moved."""
    found = NAMED.findall(text_of(page))
    assert len(found) > 8
    for name, place in found:
        (path,) = [p for p in (ROOT / place, ROOT / "frischid" / place) if p.exists()]
        assert re.search(rf"\b{name}\b", text_of(path)), f"{page.name}: {name} is not in {place}"


def test_every_command_is_in_the_table_and_on_the_page():
    lines = "".join(script("hooks").command_lines())
    assert all(f"## frischid {name}\n" in lines for name in main.commands)
    table = re.findall(r"^\| `frischid (\w+)", text_of(DOCS / "reference" / "cli.md"), flags=re.MULTILINE)
    assert set(table) == set(main.commands), "a command needs a row in the table of docs/reference/cli.md"


def test_every_public_name_is_in_the_reference():
    import frischid

    hooks = script("hooks")
    shown = re.findall(r"::: [\w.]+\.(\w+)", "".join(hooks.name_lines()))
    results = [path.rpartition(".")[2] for path in hooks.RESULTS]
    assert sorted(shown) == sorted([*(set(frischid.__all__) - {"__version__"}), *results])
    for path in hooks.RESULTS:  # each says what it is, and what its fields are
        module, _, name = path.rpartition(".")
        words = getattr(importlib.import_module(f"frischid.{module}"), name).__doc__
        assert words


def documented():
    """Every object of the Python page, and the public methods of its classes."""
    import frischid

    paths = script("hooks").RESULTS
    objects = [getattr(importlib.import_module(f"frischid.{m}"), n) for m, _, n in (p.rpartition(".") for p in paths)]
    for found in (*(getattr(frischid, name) for name in frischid.__all__ if name != "__version__"), *objects):
        yield found
        for name, value in vars(found).items() if inspect.isclass(found) else ():
            method = value.__func__ if isinstance(value, (classmethod, staticmethod)) else value
            if inspect.isfunction(method) and not name.startswith("_"):
                yield method


def test_every_number_array_and_error_of_the_python_page_is_explained():
    section = r"^(Parameters|Attributes|Returns|Raises)\n-+\n(.*?)(?=^\w[\w ]*\n-{3,}|\Z)"
    for found in documented():
        text = inspect.getdoc(found) or ""
        for title, body in re.findall(section, text + "\n", flags=re.MULTILINE | re.DOTALL):
            for head, words in re.findall(r"^(\S[^\n]*)\n((?: {4}[^\n]*\n?|\n)*)", body, flags=re.MULTILINE):
                if title == "Raises" or re.search(r": (?:float|ndarray)", head):
                    assert words.strip(), f"{getattr(found, '__qualname__', found)}: say what {head} is, with its unit"


def toml_blocks():
    for page in PAGES:
        for block in re.findall(r"```toml\n(.*?)```", text_of(page), flags=re.DOTALL):
            yield pytest.param(block, id=name_of(page))


@pytest.mark.parametrize("block", [*toml_blocks()])
def test_mapping_examples_are_valid(block):
    content = tomllib.loads(block)
    (PDController if "kp" in content else LogMap).from_dict(content)  # raises where a key is not known


def test_the_package_of_an_own_effect_is_built_from_the_pages_two_files(tmp_path, monkeypatch):
    text = text_of(DOCS / "guides" / "own-effect.md")
    module, project = (re.search(rf"```{kind}\n(.*?)```", text, flags=re.DOTALL)[1] for kind in ("python", "text"))
    (tmp_path / "my_effect.py").write_text(module, encoding="utf-8")
    (tmp_path / "pyproject.toml").write_text(project, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    wheel = zipfile.ZipFile(importlib.import_module("hatchling.build").build_wheel(str(tmp_path)))
    (announced,) = tomllib.loads(project)["project"]["entry-points"]["frischid.effects"].values()
    entries = next(name for name in wheel.namelist() if name.endswith("entry_points.txt"))
    assert announced in wheel.read(entries).decode()
    file, _, name = announced.partition(":")
    assert f"class {name}(" in wheel.read(f"{file}.py").decode()


@needs_browser
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_axe_finds_nothing_in_the_guide_to_the_report(site, width, scheme):
    with opened((site / "guides" / "see.html").as_uri(), width=width, scheme=scheme) as seen:
        assert violations(seen.page) == []
        assert seen.complaints == []


@pytest.mark.parametrize("command", sorted(main.commands))
def test_help_of_every_command(command):
    result = CliRunner().invoke(main, [command, "--help"])
    assert result.exit_code == 0
    assert "Usage" in result.output


def test_the_page_on_examples_lists_every_notebook():
    listed = re.findall(r"^\| `(\w+\.ipynb)`", text_of(DOCS / "start" / "examples.md"), flags=re.MULTILINE)
    assert sorted(listed) == sorted(path.name for path in (ROOT / "examples" / "notebooks").glob("*.ipynb"))


def test_the_paper_is_as_short_as_the_journal_asks():
    body = re.sub(r"^\|.*$|<!--.*?-->", "", text_of(ROOT / "paper" / "paper.md").split("---", 2)[2], flags=re.MULTILINE)
    assert 250 <= len(body.split()) <= 1000
    for picture in re.findall(r"\]\((\S+\.(?:png|svg|webp))\)", body):
        assert any(Path(picture).name in text_of(script) for script in DOCS.glob("*.py")), f"no script draws {picture}"


def test_pages_repeat_the_payload_that_the_guide_prints():
    """tests/docs/test_text_blocks.py computes the guide's figure from the measured logs."""
    printed = re.search(r"^mass +kg +(\d\.\d+) +(\d\.\d+)", text_of(DOCS / "guides" / "payload.md"), flags=re.MULTILINE)
    mass, bound = (f"{float(x):.2f}" for x in printed.groups())
    for page in (ROOT / "paper" / "paper.md", DOCS / "robots" / "ur10e.md", DOCS / "guides" / "payload.md"):
        assert re.search(rf"{mass} ± {bound} kg", shown(page)), page.name


def test_words_about_the_six_robots_follow_from_the_stored_results():
    rows = {row["key"]: row for row in json.loads(text_of(DOCS / "data" / "six_robots.json"))["rows"]}
    coupling = rows["staubli_tx40"]["steps"][0]
    assert coupling["effect"] == "joint_coupling"
    assert 0.2 < coupling["test_after"] / coupling["test_before"] < 0.3  # "falls by three quarters"
    assert rows["staubli_tx40"]["joints"]["joint_5"]["identified"] > 1.5  # "far worse than a constant torque"
    assert 0.6 < rows["emps"]["improved"] / rows["emps"]["identified"] < 0.7  # "lowers the NRMSE by a third"
    assert rows["ur10e"]["identified"] < 0.5 * rows["ur10e"]["urdf_with_friction"]  # "less than half"
    assert rows["lbr_med7"]["identified"] < rows["lbr_med7"]["urdf_with_friction"]
    fall = rows["tiago"]["identified"], rows["tiago"]["improved"]
    assert fall == pytest.approx((0.109, 0.095), abs=5e-4)  # "its error falls from 0.109 to 0.095"
    above = rows["tiago"]["improved"] / rows["tiago"]["noise_floor"]
    assert above == pytest.approx(1.7, abs=0.05)  # "1.7 times that of the sensors"


def test_versions_agree():
    version = tomllib.loads(text_of(ROOT / "pyproject.toml"))["project"]["version"]
    assert f"\nversion: {version}\n" in text_of(ROOT / "CITATION.cff")
    assert re.search(r"^## (\S+)", text_of(ROOT / "CHANGELOG.md"), flags=re.MULTILINE)[1] == version
    assert f"frischid-{version}-py3" in text_of(DOCS / "start" / "install.md")


# ---- the built site


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The site, built as its readers have it; a warning is an error (``strict``)."""
    for module in ("material", "mkdocstrings"):
        pytest.importorskip(module, reason="the extra frischid[docs] is not installed")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return folder


def test_a_warning_of_the_site_is_an_error():
    settings = text_of(ROOT / "mkdocs.yml")
    assert re.search(r"^strict: true$", settings, flags=re.MULTILINE)
    for name in ("omitted_files", "not_found", "anchors", "absolute_links", "unrecognized_links"):
        assert f"{name}: warn" in settings, f"mkdocs says {name} only as information"


def test_the_site_needs_no_network(site):
    """Nothing that a browser loads by itself has an address of another host."""
    loaded = r"""<(?:script|link|img|iframe|source|video|object)[^>]+?(?:src|href|data)=["']?(?:https?:)?//[^"'> ]+"""
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > len(PAGES)
    for page in pages:
        assert not re.findall(loaded, text_of(page)), page.name
    for style in site.rglob("*.css"):
        assert not re.findall(r"""(?:url\(|@import )["']?(?:https?:)?//[^"')]+""", text_of(style)), style.name


class Parsed(HTMLParser):
    """Links of a page, and the names that a link may lead to."""

    def __init__(self, page):
        super().__init__()
        self.links, self.names = [], set()
        self.feed(text_of(page))

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.names |= {found[key] for key in ("id", "name") if found.get(key)}
        if tag == "a" and found.get("href"):
            self.links.append(unquote(found["href"]))


def test_every_link_of_the_site_leads_to_a_place_that_exists(site):
    parsed = {page: Parsed(page) for page in site.rglob("*.html") if page.name != "404.html"}
    checked = 0
    for page, found in parsed.items():
        for link in found.links:
            if re.match(r"[a-z]+:", link):
                continue  # another site: .github/workflows/links.yml
            path, _, anchor = link.partition("#")
            target = (page.parent / path).resolve() if path else page
            target = target / "index.html" if target.is_dir() else target
            assert target.exists(), f"{page.name}: {link}"
            assert not anchor or target not in parsed or anchor in parsed[target].names, f"{page.name}: {link}"
            checked += 1
    assert checked > 1000


def test_files_that_the_workflows_name_exist():
    for path in [
        *sorted((ROOT / ".github" / "workflows").glob("*.yml")),
        *sorted((ROOT / ".ci").iterdir()),
    ]:
        named = re.findall(r"(?:tests|docs|\.ci)/[\w./]*\w", text_of(path))
        assert all((ROOT / name).exists() for name in named if "**" not in name), path.name


def test_the_workflow_of_links_reads_every_page():
    lines = text_of(ROOT / ".github" / "workflows" / "links.yml")
    assert all(name in lines for name in ("README.md", "CONTRIBUTING.md", "./docs/**/*.md", "paper/paper.md"))
