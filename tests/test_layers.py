"""Who may import whom, read from the sources; and what ``import jssa_gym`` must not load."""

import ast
import itertools
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

import jssa_gym

PACKAGE = Path(jssa_gym.__file__).parent

LAYERS = (
    ("kernels", "exceptions", "headless", "registration"),
    ("tick", "types", "validation", "rates", "storage", "text", "palette", "vectors"),
    ("robots", "humans"),
    ("safety",),
    ("perception", "engine"),
    ("shields", "envs", "control"),
    ("policies", "guard", "entry_points"),
    ("evaluation",),
    ("train", "paper", "certificate", "datasets", "board"),
    ("plots",),
    ("viewer", "hardware"),
    ("cli",),
    ("__main__",),
)
"""Lowest first; members of one layer are siblings and import none of each other."""
LEVEL = {name: level for level, names in enumerate(LAYERS) for name in names}

HEAVY = {
    "torch": ("train", "policies", "cli.train"),
    "stable_baselines3": ("train", "policies"),
    "sb3_contrib": ("train",),
    "osqp": ("safety.projectors",),
    "ray": ("engine.cluster",),
    "h5py": ("datasets.minari",),
    "matplotlib": ("plots",),
    "av": ("plots",),
    "viser": ("viewer",),
    "trimesh": ("viewer",),
    "msgspec": ("viewer",),
    "websockets": ("viewer",),
    "mujoco": (
        *("headless", "robots.coverage", "robots.mjcf", "robots.model", "robots.prepare"),
        *("robots.reading", "robots.serial", "envs.drawing", "envs.opengl", "envs.backdrop"),
        *("envs.window", "envs.world", "evaluation.oracle"),
    ),
    "glfw": ("envs.window",),
    "PIL": ("plots",),
}
"""Where a heavy library may be imported at all, and there only inside functions."""

WHOLLY_HEAVY = (
    *("train.lagrangian", "train.learner", "train.loop", "train.state", "train.vector"),
    *(f"viewer.{name}" for name in ("capsules", "charts", "page", "panel", "scene", "server", "shapes")),
)
"""Modules that import such libraries at once, and are themselves imported by others inside functions only."""


parsed = cache(ast.parse)
"""A module's source as a tree, which none of the tests changes."""


def _for_type_checkers(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def imports(tree: ast.Module, module: str, package: bool = False):
    """All imports as (dotted name, line, inside a function, for type checkers only); relative ones resolved."""

    def visit(node, inside, typing_only):
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.Import):
                for alias in child.names:
                    yield alias.name, child.lineno, inside, typing_only
            elif isinstance(child, ast.ImportFrom):
                base = child.module or ""
                if child.level:
                    parents = module.split(".")
                    parents = parents[: len(parents) - child.level + (1 if package else 0)]
                    base = ".".join([*parents, *([base] if base else [])])
                for alias in child.names:
                    yield f"{base}.{alias.name}", child.lineno, inside, typing_only
            else:
                function = isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
                yield from visit(child, inside or function, typing_only or _for_type_checkers(child))

    yield from visit(tree, False, False)


def violations(source: str, module: str, package: bool = False) -> list[str]:
    """What one module's source does against the rules; ``module`` is its dotted name, e.g. jssa_gym.envs.arm."""
    tree, found = parsed(source), []
    inner = module.removeprefix("jssa_gym").removeprefix(".")
    own = inner.split(".")[0]
    if own and own not in LEVEL:
        return [f"{module} belongs to no layer"]
    for name, line, inside, typing_only in imports(tree, module, package):
        top, *rest = name.split(".")
        where = f"{module}:{line}"
        later = inside or typing_only or inner in WHOLLY_HEAVY
        if top == "jssa_gym" and ".".join(rest[:2]) in WHOLLY_HEAVY and not later:
            found.append(f"{where} imports {name} outside of a function")
        if top == "jssa_gym":
            target = rest[0] if rest and rest[0] in LEVEL else ""
            if own == "":
                # the root registers names; it loads what it offers on first use
                if target not in ("exceptions", "registration") and not inside and not typing_only:
                    found.append(f"{where} the root imports {name} at once")
            elif target == "":
                found.append(f"{where} imports the root: {name}")
            elif target != own and LEVEL[target] >= LEVEL[own]:
                found.append(f"{where} {own} imports {target}, which is not below it")
        elif top in HEAVY and not typing_only:
            if not any(inner == place or inner.startswith(place + ".") for place in HEAVY[top]):
                found.append(f"{where} {top} has no place here")
            elif not later:
                found.append(f"{where} {top} is imported outside of a function")
        elif top == "numba" and own not in ("kernels", "tick"):
            found.append(f"{where} numba outside of kernels and control step")
    if own not in ("cli", "__main__"):
        found += [
            f"{module}:{node.lineno} print"
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
        ]
    return found


def sources() -> list[tuple[str, bool, Path]]:
    """Dotted name, whether it is a package, and path of every module."""
    listed = []
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        package = parts[-1] == "__init__"
        listed.append((".".join(parts[:-1] if package else parts), package, path))
    return listed


def test_a_module_imports_only_from_below():
    found = (violations(path.read_text(), module, package) for module, package, path in sources())
    assert [wrong for some in found for wrong in some] == []


def test_all_layers_of_the_package_were_read():
    seen = {module.split(".")[1] for module, _, _ in sources() if "." in module}
    assert {"kernels", "tick", "types", "robots", "humans", "safety", "shields", "envs", "control", "policies"} <= seen
    assert {"plots", "evaluation", "train", "paper", "certificate", "cli", "exceptions", "headless", "__main__"} <= seen


def test_no_two_classes_have_one_name():
    classes = [
        node.name
        for _, _, path in sources()
        for node in parsed(path.read_text()).body
        if isinstance(node, ast.ClassDef)
    ]
    assert len(classes) > 100
    assert [name for name in sorted(set(classes)) if classes.count(name) > 1] == []


@pytest.mark.parametrize(
    ("module", "source", "message"),
    [
        ("jssa_gym.safety.fake", "from jssa_gym.envs import ArmEnv", "safety imports envs"),
        ("jssa_gym.humans.fake", "from jssa_gym.robots import RobotModel", "humans imports robots"),
        ("jssa_gym.envs.fake", "import jssa_gym.shields.jssa", "envs imports shields"),
        ("jssa_gym.shields.fake", "def f():\n    from jssa_gym.control import Cascade", "shields imports control"),
        ("jssa_gym.plots", "from jssa_gym.cli import demo", "plots imports cli"),
        ("jssa_gym.paper.fake", "from jssa_gym.certificate import census", "paper imports certificate"),
        ("jssa_gym.evaluation.fake", "from jssa_gym.paper import claims", "evaluation imports paper"),
        ("jssa_gym.kernels.fake", "from jssa_gym.exceptions import ParameterError", "kernels imports exceptions"),
        ("jssa_gym.kernels.fake", "from jssa_gym.tick import codes", "kernels imports tick"),
        ("jssa_gym.tick.fake", "from jssa_gym.types import Status", "tick imports types"),
        ("jssa_gym.evaluation.fake", "from ..cli import demo", "evaluation imports cli"),
        ("jssa_gym.evaluation.fake", "from .. import cli", "evaluation imports cli"),
        ("jssa_gym.types", "import jssa_gym", "imports the root"),
        ("jssa_gym", "from jssa_gym.envs import ArmEnv", "the root imports"),
        ("jssa_gym.helpers", "", "belongs to no layer"),
        ("jssa_gym.safety.projectors", "import osqp", "outside of a function"),
        ("jssa_gym.plots", "from matplotlib.figure import Figure", "outside of a function"),
        ("jssa_gym.envs.arm", "def f():\n    import mujoco", "no place here"),
        ("jssa_gym.envs.arm", "class A:\n    import torch", "no place here"),
        ("jssa_gym.train.config", "import torch", "torch is imported outside of a function"),
        ("jssa_gym.train", "from jssa_gym.train.loop import train", "imports jssa_gym.train.loop.train outside"),
        ("jssa_gym.train.config", "from jssa_gym.train import learner", "imports jssa_gym.train.learner outside"),
        ("jssa_gym.cli.train", "import torch", "torch is imported outside of a function"),
        ("jssa_gym.cli.demo", "def f():\n    import torch", "no place here"),
        ("jssa_gym.safety.fake", "from numba import njit", "numba outside"),
        ("jssa_gym.envs.fake", "def f():\n    print('x')", "print"),
    ],
)
def test_the_check_sees_a_violation(module, source, message):
    found = violations(source, module, package=module == "jssa_gym")
    assert len(found) == 1
    assert message in found[0]


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("jssa_gym.policies.fake", "from jssa_gym.control import Cascade"),
        ("jssa_gym.cli.fake", "from jssa_gym.envs import ArmEnv\nprint('x')"),
        ("jssa_gym.plots", "def f():\n    import av\n    from matplotlib import figure"),
        ("jssa_gym.robots.model", "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import mujoco"),
        ("jssa_gym.safety.fake", "from .index import IndexParams"),
        ("jssa_gym.train.loop", "import torch\nfrom jssa_gym.train.learner import build"),
        ("jssa_gym.cli.train", "def f():\n    import torch\n    from jssa_gym.train.loop import train"),
    ],
)
def test_the_check_lets_pass_what_is_right(module, source):
    assert violations(source, module) == []


def test_importing_the_package_loads_nothing_heavy_and_registers_the_ids():
    script = (
        "import sys, jssa_gym, gymnasium\n"
        "heavy = ('torch', 'stable_baselines3', 'osqp', 'matplotlib', 'mujoco', 'numba', 'av', 'scipy', 'viser')\n"
        "print([name for name in heavy if name in sys.modules])\n"
        "print(sorted(name for name in gymnasium.registry if name.startswith('jssa_gym/')))\n"
    )
    run = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, check=True)
    loaded, ids = run.stdout.splitlines()
    assert loaded == "[]"
    expected = [f"{name}{kind}-v0" for name in ("Home", "Reach", "Track", "Handover") for kind in ("", "Shielded")]
    assert set(ast.literal_eval(ids)) >= {f"jssa_gym/{name}" for name in expected}


def test_public_names_are_what_they_say():
    # what an environment of one's own, or a comparison, is made of
    assert {"TASKS", "Task", "Walk", "make_human", "SeparationParams", "Shield"} <= set(jssa_gym.__all__)
    for name in jssa_gym.__all__:
        assert name in dir(jssa_gym)
        assert getattr(jssa_gym, name) is not None
    with pytest.raises(AttributeError, match="no_such_name"):
        jssa_gym.no_such_name  # noqa: B018


def test_tests_stand_where_what_they_test_does():
    tests = Path(__file__).parent
    packages = [place.parent.name for place in sorted(PACKAGE.glob("*/__init__.py"))]
    assert len(packages) > 20
    assert [name for name in packages if not any((tests / name).glob("test_*.py"))] == []


def test_a_docstring_says_what_something_is_before_what_it_is_of():
    told = []
    for module, _, path in sources():
        for node in ast.walk(parsed(path.read_text())):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                first = (ast.get_docstring(node) or "None").split()[0]
                told += [f"{module}.{node.name}: {first}"] if first in ("Of", "In", "By", "At", "From", "For") else []
            # an attribute's is the string behind it
            body = node.body if isinstance(node, ast.Module | ast.FunctionDef | ast.ClassDef) else []
            for before, after in itertools.pairwise(body):
                if isinstance(before, ast.Assign | ast.AnnAssign) and isinstance(after, ast.Expr):
                    text = getattr(after.value, "value", None)
                    told += [f"{module}: {text}"] if isinstance(text, str) and text.startswith("Of ") else []
    assert told == []
