"""Template of a scenario file with default values: title, seed, and all tables that have a `kind`.

The template is generated from the schema, with the texts of `agrobot-mj explain`, and is a valid scenario.
"""

import json
from pathlib import Path
from textwrap import wrap

import tomli_w

from agrobot_mj.core.errors import ScenarioError
from agrobot_mj.core.spec import members
from agrobot_mj.core.walk import TableClass, places
from agrobot_mj.scenario.reference import families, first_line, usual_kind
from agrobot_mj.scenario.schema import Scenario

SKIPPED = ("name", "title", "version", "seed")  # Keys that the header of the template contains, or that a run writes
HEAD = """\
# {name}: purpose of this experiment
# Expected result: ...
#
# Every key has a default. To change a key, remove the `# ` before it. Delete all keys that you do not change.
# `agrobot-mj explain KEY` describes a key, for example `agrobot-mj explain path.kind`.
"""


def write_template(name: str) -> Path:
    """Write the template to a new file `name`.toml. Raises `ScenarioError` if the file exists."""
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    if path.stem in ("", ".toml") or not path.stem.strip("."):
        raise ScenarioError(f"init {name!r}: this is not a valid name; specify a name such as my_field")
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(template(path.stem))
    except FileExistsError:
        raise ScenarioError(f"{path}: the file already exists; choose another name") from None
    return path


def template(name: str) -> str:
    """Return the template of a scenario `name` as text."""
    shown = "".join(letter if letter.isprintable() else " " for letter in name).strip()
    whole = TableClass((), Scenario, Scenario())
    lines = [HEAD.format(name=shown), f"title = {json.dumps(shown, ensure_ascii=False)}", f"seed = {Scenario().seed}"]
    for key, field in Scenario.model_fields.items():
        if not members(field.annotation) and key not in SKIPPED:
            lines += ["", *_key(whole, key)]
    found = [key for key in families() if (usual_kind(key) or "." not in key) and _in_default(key)]
    for key in sorted(found, key=lambda key: usual_kind(key) is None):
        lines += ["", *(_table(key) if usual_kind(key) else _list(key))]
    others = [key for key, field in Scenario.model_fields.items() if members(field.annotation) and key not in found]
    return "\n".join([*lines, "", f"# Further tables: {', '.join(others)}; see `agrobot-mj explain {others[0]}`.", ""])


def _in_default(key: str) -> bool:
    part: object = Scenario()
    for name in key.split("."):
        part = getattr(part, name, None)
    return part is not None


def _key(place: TableClass, name: str) -> list[str]:
    about = wrap(" ".join(place.owner.describe(name).split()), 118)
    value = getattr(place.default, name, None)
    line = f"{name} =" if value is None else tomli_w.dumps({name: value}).strip()
    return [*(f"# {text}" for text in about), *(f"# {text}" for text in line.splitlines())]


def _table(key: str) -> list[str]:
    kind = usual_kind(key)
    place = next(place for place in places(Scenario(), key.split(".")) if place.kinds[-1] == (key, kind))
    lines = [*_kinds(key), f"[{key}]", f'kind = "{kind}"']
    for name, field in place.owner.model_fields.items():
        if members(field.annotation):
            lines.append(f"# [{key}.{name}]: see `agrobot-mj explain {key}.{name}`")
        elif name != "kind":
            lines += _key(place, name)
    return lines


def _list(key: str) -> list[str]:
    kind = next(iter(families()[key]))
    return [*_kinds(key), f"# [[{key}]]", f'# kind = "{kind}"', f"# see `agrobot-mj explain {key}`"]


def _kinds(key: str) -> list[str]:
    kinds = families()[key]
    width = max(map(len, kinds))
    return ["# Kinds:", *(f"#   {kind:{width}}  {first_line(part, kind)}" for kind, part in kinds.items())]
