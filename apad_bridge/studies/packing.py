"""Packs a study or a run as one archive to publish beside a paper: inputs, versions, results, and a script that repeats it.

The archive has one folder. In it `study/` or `run/` holds the records, and `repeat.sh` flies them again into `again/` and
compares the figures. No file that the missions need lies outside.
"""

from __future__ import annotations

import json
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, distribution, entry_points
from pathlib import Path
from shutil import copy2
from typing import Any

from packaging.requirements import Requirement

from apad_bridge.planning.registry import GROUP as STRATEGIES
from apad_bridge.records.run_directory import RunDirectory, versions
from apad_bridge.runs.supervisor_lock import supervisor_of
from apad_bridge.scenario.errors import UserError
from apad_bridge.scenario.loader import launch_scripts, write_with_files
from apad_bridge.scenario.run_options import RunOptions, TimeSource
from apad_bridge.studies.runner import JOURNAL, is_flying
from apad_bridge.studies.specification import STUDY_FILE
from firmware_model.packets.codec import GROUP as CODECS
from firmware_model.sampling.sensors import GROUP as SENSORS

_PACKAGE = "musselbed"
_EXTRAS = ("", "netcdf", "studies")
"""The extras that decide figures; "" stands for none."""
_PINS = launch_scripts("requirements")
"""The versions that the installer brings, with the hashes of their files."""
_CRATE = "https://w3id.org/ro/crate/"
_NOT_PACKED = ("fleet", "modems", "checkpoint.jsonl", "supervisor.pid", "scenario.yaml")
"""Names of a run that belong to its processes; its scenario is written anew."""


@dataclass(frozen=True, slots=True)
class _Repeat:
    """The way to fly a packed thing again, in words and in the lines of a POSIX shell."""

    promise: str
    fly: str
    compare: str


def pack(source: Path, out: Path | None = None) -> Path:
    """Packs the directory of a study or of a run into `out`, by default NAME.tar.gz here; returns its path.

    The archive appears whole or not at all. UserError for anything else, for what still flies or has not ended, and for an
    archive that is there, and for a symbolic link in the directory.
    """
    name = source.absolute().name
    archive = Path(f"{name}.tar.gz") if out is None else out
    if archive.exists():
        raise UserError(f"{archive}: is there already: choose another place with --out")
    archive.absolute().parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=archive.absolute().parent, prefix=f".{archive.name}.") as scratch:
        folder = Path(scratch) / name
        folder.mkdir()
        if (source / JOURNAL).is_file():
            repeat = _pack_study(source, folder / "study")
        elif (source / "scenario.yaml").is_file():
            repeat = _pack_run(source, folder / "run")
        else:
            raise UserError(f"{source}: neither a study ({JOURNAL}) nor a run (scenario.yaml)")
        _describe(folder, repeat)
        whole = Path(scratch) / archive.name
        with tarfile.open(whole, "w:gz") as tar:
            tar.add(folder, name, filter=_without_owner)
        whole.rename(archive)
    return archive


def _pack_study(source: Path, folder: Path) -> _Repeat:
    if not (source / STUDY_FILE).is_file():
        raise UserError(f"{source}: has no {STUDY_FILE}: fly the study again with this version")
    if is_flying(source):
        raise UserError(f"{source}: the study still flies: pack it at its end")
    _copy(source, folder, ())
    return _Repeat(
        "All figures of all missions are compared, digit by digit.",
        f'"$musselbed" study study/{STUDY_FILE} --out again',
        # The first line names the version; the others are in the order in which the missions ended.
        f"tail -n +2 study/{JOURNAL} | sort >study.figures; tail -n +2 again/{JOURNAL} | sort >again.figures\n"
        "cmp study.figures again.figures",
    )


def _pack_run(source: Path, folder: Path) -> _Repeat:
    if supervisor_of(source) is not None:
        raise UserError(f"{source}: the run still flies: pack it at its end")
    if not (source / "summary.json").is_file():
        raise UserError(f"{source}: has no summary.json: the run did not end")
    options, scenario = RunOptions.load(source), RunDirectory(source).scenario_as_flown()
    _copy(source, folder, _NOT_PACKED)
    write_with_files(folder / "scenario.yaml", scenario)
    flown = "script run/script.py --scenario" if options.script else "run"
    fly = f'"$musselbed" {flown} run/scenario.yaml --time asap --out again'
    if options.time is TimeSource.ASAP:
        return _Repeat(
            "The summaries are compared, digit by digit.", fly, "cmp run/summary.json again/summary.json"
        )
    return _Repeat(
        "The run was flown by a clock, and a repetition flies in virtual time: its figures stand beside the run's.",
        fly,
        '"$musselbed" runs .',
    )


def _copy(source: Path, folder: Path, left_out: tuple[str, ...]) -> None:
    """Copies the regular files, also of folders; files that are being written have names with a leading dot.

    UserError for a symbolic link: it would bring a file into the archive that nobody meant to publish.
    """
    folder.mkdir()
    for path in sorted(source.iterdir()):
        if path.is_symlink():
            raise UserError(
                f"{path}: a symbolic link, to {path.readlink()}: put the file itself there, or take the link away"
            )
        if path.name.startswith(".") or path.name in left_out:
            continue
        if path.is_dir():
            _copy(path, folder / path.name, _NOT_PACKED[:-1])
        elif path.is_file():
            copy2(path, folder / path.name, follow_symlinks=False)


def _describe(folder: Path, repeat: _Repeat) -> None:
    pins, own = pinned(), distribution(_PACKAGE).version
    (folder / "requirements.txt").write_text("".join(f"{line}\n" for line in _with_hashes(pins)))
    (folder / "versions.json").write_text(json.dumps(versions(), indent=2) + "\n")
    (folder / "README.md").write_text(
        f"# {folder.name}\n\n"
        f"Flown with musselbed {own}. To repeat it, install that version, the packages of `requirements.txt` beside it\n"
        "(`pip install -r requirements.txt`), and call\n\n"
        "    sh repeat.sh\n\n"
        f"{repeat.promise} `MUSSELBED` may name the program. `versions.json` has the versions of Python and ROS.\n"
    )
    script = folder / "repeat.sh"
    script.write_text(
        "#!/bin/sh\n# Flies it again into again/, and compares the figures. MUSSELBED names the program.\n"
        'set -eu\ncd "$(dirname "$0")"\nmusselbed=${MUSSELBED:-musselbed}\n'
        f'{repeat.fly}\n{repeat.compare}\necho "repeated: {repeat.promise}"\n'
    )
    script.chmod(0o755)
    _write_crate(folder, repeat, own)


def _write_crate(folder: Path, repeat: _Repeat, version: str) -> None:
    """Describes the folder as an RO-Crate, version 1.1: its files, the program that made them, and how to repeat them.

    Source: https://www.researchobject.org/ro-crate/1.1/. Whoever publishes the archive chooses its licence.
    """
    files = [{"@id": it.relative_to(folder).as_posix()} for it in sorted(folder.rglob("*")) if it.is_file()]
    crate, program = "ro-crate-metadata.json", {"@id": "#musselbed"}
    graph: list[dict[str, Any]] = [
        {
            "@id": crate,
            "@type": "CreativeWork",
            "about": {"@id": "./"},
            "conformsTo": {"@id": f"{_CRATE}1.1"},
        },
        {
            "@id": "./",
            "@type": "Dataset",
            "name": folder.name,
            "description": f"Flown with musselbed {version}. `sh repeat.sh` flies it again. {repeat.promise}",
            "datePublished": f"{datetime.now(UTC):%Y-%m-%d}",
            "license": "chosen by whoever publishes this archive",
            "hasPart": files,
        },
        {**program, "@type": "SoftwareApplication", "name": "musselbed", "softwareVersion": version},
        {"@id": "#flown", "@type": "CreateAction", "instrument": program, "result": {"@id": "./"}},
        *({**it, "@type": "File", "contentSize": str((folder / it["@id"]).stat().st_size)} for it in files),
    ]
    text = json.dumps({"@context": f"{_CRATE}1.1/context", "@graph": graph}, indent=1)
    (folder / crate).write_text(text + "\n")


def _with_hashes(pins: Sequence[tuple[str, str]]) -> list[str]:
    """Lines of a requirements file, with hashes where the installer pins all of these versions: pip takes all or none.

    A package's files for each Python that the installer pins it for count, so that either Debian can repeat it.
    """
    names = [f"{name}=={version}" for name, version in pins]
    hashes: dict[str, dict[str, None]] = {}
    for path in sorted(_PINS.glob("*/*.txt")):
        for name, _, its_hash in (line.partition(" ") for line in path.read_text().splitlines()):
            if its_hash.startswith("--hash="):
                hashes.setdefault(name, {})[its_hash] = None
    return [" ".join([name, *hashes[name]]) for name in names] if hashes.keys() >= set(names) else names


def pinned() -> list[tuple[str, str]]:
    """(name, version) of each package that musselbed, or a package with strategies or codecs of a user, needs here.

    musselbed itself is left out, as are packages that are not installed.
    """
    plugins = {
        entry.dist.name
        for group in (STRATEGIES, CODECS, SENSORS)
        for entry in entry_points(group=group)
        if entry.dist
    }
    found: dict[str, tuple[str, str]] = {}
    done: set[tuple[str, frozenset[str]]] = set()
    waiting = [
        Requirement(f"{_PACKAGE}[{','.join(filter(None, _EXTRAS))}]"),
        *map(Requirement, sorted(plugins)),
    ]
    while waiting:
        wanted = waiting.pop()
        key = wanted.name.lower().replace("_", "-")
        if (key, frozenset(wanted.extras)) in done:
            continue
        done.add((key, frozenset(wanted.extras)))
        try:
            here = distribution(wanted.name)
        except PackageNotFoundError:
            continue
        found[key] = (here.name, here.version)
        waiting += _needs(here.requires or (), wanted.extras)
    return [pin for key, pin in sorted(found.items()) if key != _PACKAGE]


def _needs(requires: Sequence[str], extras: set[str]) -> Iterator[Requirement]:
    for requirement in map(Requirement, requires):
        marker = requirement.marker
        if marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras)):
            yield requirement


def _without_owner(member: tarfile.TarInfo) -> tarfile.TarInfo:
    member.uid = member.gid = 0
    member.uname = member.gname = ""
    return member
