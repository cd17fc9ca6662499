"""The command line: finds the command, parses its arguments, prints mistakes on one line.

Exit codes: 0 done; 2 a mistake that the user can mend; 130 stopped by Ctrl-C (what was finished is kept).
Each command is a module with ``Arguments`` (a dataclass, its docstrings are the help), ``main(arguments)``, and, when
its defaults depend on the command line, ``defaults(argv)``. A command's module is imported when it is called.
"""

import difflib
import importlib
import logging
import os
import sys
from collections.abc import Sequence
from types import ModuleType

from wildpuppet.errors import SettingsError, WildPuppetError

COMMANDS = {
    "run": ("run", "turn a clip with one box around a character into puppet meshes, frame by frame"),
    "fit": ("fit", "fit a puppet to a folder of unordered drawings"),
    "train": ("train", "train a network for one puppet from a run or from drawings"),
    "points": ("points", "carry points from one frame to every frame of a run"),
    "flow": ("flow", "write the dense map between two frames of a run"),
    "export": ("export", "write a run in the formats of other programs"),
    "paint": ("paint", "draw every frame with a texture that was painted on once"),
    "formats": ("formats", "list those formats: what opens them, how exact they are"),
    "refine": ("refine", "draw every frame of a run as it would have been drawn"),
    "inbetween": ("inbetween", "draw frames between two frames of a run, at any size"),
    "deform": ("deform", "drag points of the puppet in one frame of a run; the rest follows"),
    "retarget": ("retarget", "put the motion of a run on another puppet"),
    "status": ("status", "say for each stage whether it is kept or would run, and why"),
    "prune": ("prune", "clear results that no run refers to"),
    "puppet import": ("puppet_import", "turn another tool's file (PSD, ORA, PNGs, SVG, ...) into a puppet folder"),
    "puppet from-outlines": ("puppet_from_outlines", "cut a puppet out of one frame along outlines"),
    "puppet check": ("puppet_check", "say in words what is wrong with a puppet folder, and draw overlay.png"),
    "reproduce": ("reproduce", "print the paper's tables on a benchmark and draw its figures"),
    "evaluate": ("evaluate", "carry a benchmark's points and print the accuracy table"),
    "ablate": ("ablate", "evaluate with one thing switched off at a time: what each is worth"),
    "bench": ("benchmark", "time the renderer and a run"),
}


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command line and exit."""
    sys.exit(run_command(list(sys.argv[1:] if argv is None else argv)))


def run_command(argv: list[str]) -> int:
    """Run one command; give the exit code."""
    logging.basicConfig(format="%(message)s", level=logging.WARNING, stream=sys.stderr)
    try:
        if not argv or argv[0] in ("-h", "--help"):
            sys.stdout.write(overview())
            return 0
        name, rest = command_of(argv)
        module = load(name)
        arguments = parse(module, name, rest)
        code = module.main(arguments)
        return int(code or 0)
    except WildPuppetError as error:
        return complain(str(error), 2)
    except KeyboardInterrupt:
        return complain("stopped; what was finished is kept: run again to resume", 130)
    except BrokenPipeError:  # the reader of our output left
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def overview() -> str:
    """List the commands."""
    lines = [f"  {name:<22}{what}\n" for name, (_, what) in COMMANDS.items()]
    return f"usage: wildpuppet COMMAND ...\n\n{''.join(lines)}\nwildpuppet COMMAND --help says more.\n"


def command_of(argv: list[str]) -> tuple[str, list[str]]:
    """Split the command's name off; some names have two words."""
    for words in (2, 1):
        name = " ".join(argv[:words])
        if name in COMMANDS:
            return name, argv[words:]
    near = [match for words in (2, 1) for match in difflib.get_close_matches(" ".join(argv[:words]), COMMANDS, 1)]
    hint = f"did you mean {near[0]}?" if near else f"expected one of {', '.join(COMMANDS)}"
    raise SettingsError(f"unknown command {argv[0]}; {hint}")


def load(name: str) -> ModuleType:
    """Import a command's module."""
    return importlib.import_module(f".{COMMANDS[name][0]}", __package__)


def parse(module: ModuleType, name: str, argv: list[str]) -> object:
    """Parse a command's arguments."""
    from .arguments import parse as parse_arguments
    from .arguments import with_split_box

    argv = with_split_box(argv)
    default = module.defaults(argv) if hasattr(module, "defaults") else None
    return parse_arguments(module.Arguments, argv, f"wildpuppet {name}", default)


def complain(message: str, code: int) -> int:
    """Print one line to stderr; give the code."""
    sys.stderr.write(f"wildpuppet: {' '.join(message.split())}\n")
    return code


if __name__ == "__main__":
    main()
