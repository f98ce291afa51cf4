"""The layer law: imports run one way, the numeric half knows no robot, and importing costs nothing."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import frischid

PACKAGE = Path(frischid.__file__).parent

LAYERS = (
    ("errors", "files", "inertia", "urdf_text", "words"),
    ("robot", "log", "gram", "triangular", "cluster", "archive", "store"),
    ("readers", "mapping", "tables", "bags", "signals", "effects", "trajectory", "clearance", "recording", "tree"),
    (
        *("regressor", "reduction", "estimate", "deviation", "eiv", "iv", "frisch", "bbrf", "selection", "physical"),
        *(
            "sensorwise",
            "sensitivity",
            "criteria",
            "envelope",
            "survey",
            "belief",
            "drives",
            "sharpness",
            "correlation",
        ),
    ),
    ("model",),
    ("datasets", "proposal"),
    (
        "identification",
        "inspection",
        "excitation",
        "search",
        "separation",
        "simulation",
        "comparison",
        "conditions",
        "noise",
        "prior",
        "ranking",
        "evidence",
        "pieces",
        "candidates",
        "rows",
        "resting",
        "contact",
        "sectors",
        "description",
        "findings",
        "verdict",
        "prediction",
        "quality",
    ),
    ("consistency", "gains", "diagnosis"),
    ("codegen", "mjcf", "exporting"),
    ("improvement", "shapes", "tasks", "fleet"),
    ("demo",),
    ("figures", "report"),
    ("show",),
    ("studio",),
    ("cli",),
)
NUMERIC = (
    "gram",
    "triangular",
    "reduction",
    "estimate",
    "eiv",
    "frisch",
    "sensorwise",
    "bbrf",
    "selection",
    "criteria",
    "physical",
    "drives",
    "correlation",
)
LAYER = {module: k for k, layer in enumerate(LAYERS) for module in layer}


@cache
def imports(everywhere):
    """Modules of the package -> what each imports: anywhere, or when it is itself imported."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree) if everywhere else tree.body:
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{path}: relative import"
                own = node.module == "frischid"
                names = [f"frischid.{alias.name}" for alias in node.names] if own else [node.module]
            else:
                continue
            found.setdefault(module, set()).update(names)
        found.setdefault(module, set())
    return found


def within(everywhere=True):
    """Imports inside the package, by the first part of the module's name; public names by their home."""
    home, edges = frischid._HOME, {}
    for module, names in imports(everywhere).items():
        parts = {name.split(".")[1] for name in names if name.startswith("frischid.")}
        if module not in ("__init__", "__main__"):
            edges[module] = {home.get(part, part) for part in parts} - {module}
    return edges


def test_every_module_has_a_layer():
    missing = set(within()) - set(LAYER)
    assert not missing, f"give {sorted(missing)} a layer in tests/test_layers.py"


def test_imports_run_one_way():
    upward = [
        f"{module} (layer {LAYER[module]}) imports {other} (layer {LAYER[other]})"
        for module, others in within().items()
        for other in others
        if LAYER[other] > LAYER[module]
    ]
    assert not upward


def test_imports_have_no_circle():
    edges, done = within(), set()

    def visit(module, path):
        assert module not in path, " -> ".join([*path, module])
        if module not in done:
            for other in sorted(edges[module]):
                visit(other, [*path, module])
            done.add(module)

    for module in edges:
        visit(module, [])


def test_the_package_itself_is_not_imported_within():
    assert not [m for m, names in imports(True).items() if "frischid" in names and m != "__init__"]


@pytest.mark.parametrize("module", [m for m in NUMERIC if m in imports(True)])
def test_numeric_half_knows_no_robot(module):
    seen, todo, edges = set(), [module], within()
    while todo:
        here = todo.pop()
        if here not in seen:
            seen.add(here)
            todo += edges[here]
    assert not seen & {"robot", "regressor", "effects", "signals", "log", "model"}
    for name in seen:
        roots = {full.split(".")[0] for full in imports(True)[name]}
        assert not roots & {"pinocchio", "plotly", "viser", "click", "rich"}, name


def test_only_robot_and_geometry_know_pinocchio():
    knows = {m for m, names in imports(True).items() if any(n.split(".")[0] == "pinocchio" for n in names)}
    assert "robot" in knows
    assert not knows & {"cli", "show", "report", "identification", "comparison", "diagnosis", "simulation"}


def test_public_names_exist_and_are_listed():
    for name in frischid.__all__:
        assert getattr(frischid, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'identfy'"):
        frischid.identfy  # noqa: B018


HEAVY = ("pinocchio", "cvxpy", "plotly", "viser", "scipy", "numpy", "pyarrow", "rich", "dask", "proxsuite")


@pytest.mark.parametrize(
    "start",
    ["import frischid", "import frischid.cli", "from click.testing import CliRunner\nfrom frischid.cli import main\n"
     "assert CliRunner().invoke(main, ['--help']).exit_code == 0"],
)  # fmt: skip
def test_starting_is_light(start):
    code = f"import sys\n{start}\nprint(*(m for m in {HEAVY!r} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
