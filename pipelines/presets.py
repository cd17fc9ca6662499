"""Presets: TOML files with one table per stage, given by name (``configs/NAME.toml``) or by path."""

import difflib
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import msgspec

from wildpuppet.errors import SettingsError
from wildpuppet.settings import Settings, settings_from

CONFIGS = Path(__file__).parents[1] / "configs"


def preset_names() -> list[str]:
    """Give the names of the presets that come with wildpuppet."""
    return sorted(path.stem for path in CONFIGS.glob("*.toml"))


def read_preset(name: str) -> Settings:
    """Read a preset by name or path and fill the rest with defaults; an empty name is all defaults."""
    if not name:
        return Settings()
    path = _find(name)
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path}: not valid TOML: {error}") from None
    except OSError as error:
        raise SettingsError(f"{path}: the preset cannot be read: {error.strerror}") from None
    check_names(tree, str(path))
    return settings_from(tree)


def merged(settings: Settings, changes: Mapping[str, Mapping[str, Any]]) -> Settings:
    """Lay ``changes`` (table -> setting -> value) over settings; raises SettingsError for unknown names."""
    tree = msgspec.to_builtins(settings)
    check_names({table: dict(values) for table, values in changes.items()}, "settings")
    for table, values in changes.items():
        tree[table] |= dict(values)
    return settings_from(tree)


def _find(name: str) -> Path:
    if name in preset_names():
        return CONFIGS / f"{name}.toml"
    if Path(name).is_file():
        return Path(name)
    known = preset_names()
    near = _did_you_mean(name, known)
    raise SettingsError(f"--config {name}: expected one of {', '.join(known)} or a .toml file, found neither{near}")


def check_names(tree: dict[str, Any], where: str) -> None:
    """Raise SettingsError for a table or a setting that does not exist, naming the nearest that does."""
    tables = {field.name: field.type for field in msgspec.structs.fields(Settings)}
    for table, values in tree.items():
        if table not in tables or not isinstance(values, dict):
            known = [f"{name}.{field}" for name, kind in tables.items() for field in kind.__struct_fields__]
            near = _did_you_mean(table, [*tables, *known])
            raise SettingsError(
                f"{where}: unknown setting {table}; settings stand in tables [{'] ['.join(tables)}]{near}"
            )
        for name in values:
            if name not in tables[table].__struct_fields__:
                near = _did_you_mean(name, list(tables[table].__struct_fields__))
                raise SettingsError(f"{where}: unknown setting {table}.{name}{near or '; see wildpuppet run --help'}")


def _did_you_mean(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
    return f"; did you mean {near[0]}?" if near else ""
