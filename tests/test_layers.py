"""The layer law: folders import folders above them, the numeric half knows no robot, and importing costs nothing."""

import ast
import re
import subprocess
import sys
from functools import cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

import frischid

PACKAGE = Path(frischid.__file__).parent

FOLDERS = (
    "errors",  # the one module that stands alone: every folder raises its errors
    "core",
    "robot",
    "logs",
    "effects",
    "regression",
    "motions",
    "checks",
    "estimators",
    "model",
    "forward",
    "diagnosis",
    "export",
    "fleet",
    "figures",
    "reports",
    "paper",
    "studio",
    "cli",
)
"""One folder a stage of the data flow. A folder imports only folders that stand above it."""

NUMERIC = (
    "core.types",
    "regression.moments",
    "regression.streaming_qr",
    "regression.base_parameters",
    "estimators.autocorrelation",
    "estimators.least_squares",
    "estimators.normal_equations",
    "estimators.p_values",
    "estimators.frisch",
    "estimators.sensorwise",
    "estimators.bbrf",
    "estimators.bbrf_windows",
    "estimators.nominal_links",
    "estimators.precision",
    "estimators.box_qp",
    "estimators.frisch_selection",
    "estimators.physical_links",
    "estimators.drive_gain_ls",
)
"""Modules that see numbers only. Physics makes columns, numbers make parameters."""

ROBOTICS = ("robot", "logs", "effects", "model")


def names_in(path):
    """Modules a file imports, with what it takes from packages spelled out."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            if node.module != "frischid":
                yield str(node.module)
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@cache
def modules():
    """Module of the package, without the package's name -> its file."""
    files = [p for p in sorted(PACKAGE.rglob("*.py")) if p.parent != PACKAGE or p.name == "errors.py"]
    return {".".join(p.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__"): p for p in files}


@cache
def imports():
    """Module -> everything it imports, anywhere in the file."""
    return {module: set(names_in(path)) for module, path in modules().items()}


@cache
def within():
    """Module -> modules of the package that it imports, packages as such only where no module of theirs is meant."""
    return {
        module: {n.removeprefix("frischid.") for n in names if n.removeprefix("frischid.") in modules()} - {module}
        for module, names in imports().items()
    }


def folder(module):
    return module.split(".")[0]


def test_every_folder_has_a_place():
    assert {folder(m) for m in modules()} == set(FOLDERS), (
        "list a new folder in FOLDERS, below all that it imports, and in docs/architecture_picture.py"
    )


def test_no_arrow_upwards():
    place = {name: k for k, name in enumerate(FOLDERS)}
    upward = [
        f"{module} imports {other}"
        for module, others in within().items()
        for other in others
        if place[folder(other)] > place[folder(module)]
    ]
    assert not upward, "a folder imports only folders above it in FOLDERS: move what is imported, or hand it over"


def test_imports_have_no_circle():
    done = set()

    def visit(module, path):
        assert module not in path, (
            f"{' -> '.join([*path, module])} is a circle: move what both need into a module that imports neither"
        )
        if module not in done:
            for other in sorted(within()[module]):
                if not module.startswith(f"{other}."):  # a package is imported with its modules
                    visit(other, [*path, module])
            done.add(module)

    for module in within():
        visit(module, [])


def test_the_package_itself_is_not_imported_within():
    found = [m for m, names in imports().items() if "frischid" in names]
    assert not found, "import a name from the module that defines it: `import frischid` loads the table of all names"


@pytest.mark.parametrize("module", NUMERIC)
def test_numeric_half_knows_no_robot(module):
    seen, todo = set(), [module]
    while todo:
        here = todo.pop()
        if here not in seen:
            seen.add(here)
            todo += within()[here]
    robots = {name for name in seen if folder(name) in ROBOTICS or name == "regression.regressor"} - {"robot.inertia"}
    assert not robots, f"{module} is of the numeric half (NUMERIC): give it moments or arrays, no robots or logs"
    for name in seen:
        roots = {full.split(".")[0] for full in imports()[name]}
        assert not roots & {"pinocchio", "plotly", "viser", "click", "rich"}, name


def test_only_robot_and_geometry_know_pinocchio():
    knows = {m for m, names in imports().items() if any(n.split(".")[0] == "pinocchio" for n in names)}
    wrong = {m for m in knows if folder(m) not in {"robot", "effects", "regression", "motions", "export", "studio"}}
    assert not wrong, "ask `Robot` for what Pinocchio computes; a new quantity is a method there"


def test_every_folder_says_what_it_is_for():
    for name in FOLDERS[1:]:
        text = ast.get_docstring(ast.parse((PACKAGE / name / "__init__.py").read_text(encoding="utf-8"))) or ""
        assert text.count(".") >= 3, f"frischid/{name}/__init__.py: say what comes in, what goes out, where to start"


LARGE = 20
"""Modules of a folder that needs a guide: nobody finds one module among so many by its name."""


def test_the_guide_of_a_large_folder_names_its_modules():
    for name in FOLDERS[1:]:
        within_it = {m.split(".")[1] for m in modules() if m.startswith(f"{name}.") and m.count(".") == 1}
        text = ast.get_docstring(ast.parse((PACKAGE / name / "__init__.py").read_text(encoding="utf-8"))) or ""
        missing = sorted(within_it - set(re.findall(r"`(\w+)", text))) if len(within_it) >= LARGE else []
        assert not missing, f"frischid/{name}/__init__.py: name these modules where they belong: {', '.join(missing)}"


def test_no_module_name_stands_in_two_folders():
    stems = {}
    for module in modules():
        if folder(module) not in ("cli", "figures", "reports", "studio") and "." in module:
            stems.setdefault(module.split(".")[-1], []).append(module)
    twice = {stem: found for stem, found in stems.items() if len(found) > 1}
    assert not twice, "texts name a module without its folder: rename one"


HEAVY = ("pinocchio", "cvxpy", "plotly", "viser", "scipy", "numpy", "pyarrow", "rich", "dask", "proxsuite")


@pytest.mark.parametrize(
    "start",
    ["import frischid", "import frischid.cli", "from click.testing import CliRunner\nfrom frischid.cli import main\n"
     "assert CliRunner().invoke(main, ['--help']).exit_code == 0"],
)  # fmt: skip
def test_starting_is_light(start):
    code = f"import sys\n{start}\nprint(*(m for m in {HEAVY!r} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "", f"`{start}` loads these: import them in the functions that need them"


TEXT_PAGES = sorted(p.stem for p in (PACKAGE / "cli" / "pages").glob("[a-z]*.py") if p.stem not in ("seeing", "paper"))


def test_commands_that_print_text_load_no_figures():
    code = (
        "import sys\nfrom importlib import import_module\n"
        f"for page in {TEXT_PAGES}:\n"
        "    import_module(f'frischid.cli.pages.{page}')\n"
        "    found = [m for m in ('plotly', 'viser') if m in sys.modules]\n"
        "    assert not found, f'{page} loads {found}'"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_picture_of_the_folders_is_the_code():
    script = PACKAGE.parent / "docs" / "architecture_picture.py"
    spec = spec_from_file_location("architecture_picture", script)
    drawn = module_from_spec(spec)
    spec.loader.exec_module(drawn)
    assert drawn.TARGET.read_text(encoding="utf-8") == drawn.picture(), "run python docs/architecture_picture.py"


SCRIPTS = [path for folder in ("benchmarks", "docs") for path in sorted((PACKAGE.parent / folder).glob("*.py"))]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_scripts_import_names_that_exist(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "frischid":
            home = import_module(str(node.module))
            for alias in node.names:
                if not hasattr(home, alias.name):
                    import_module(f"{node.module}.{alias.name}")


def constants(path):
    """Names in capitals that a module defines at its top level; imports do not count."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(name, ast.Name) and name.id.isupper():
                    yield name.id


def test_the_name_of_a_constant_means_one_thing():
    found = {}
    for module, path in modules().items():
        for name in constants(path):
            found.setdefault(name, set()).add(module)
    twice = {name: homes for name, homes in found.items() if len(homes) > 1}
    assert not twice, "import the constant if it means the same, otherwise rename one"
