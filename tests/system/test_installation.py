"""launch_scripts/install where it may not or cannot install: one line that says exactly what is missing.

The programs that it asks are replaced on PATH, so that nothing of this machine changes. pip is the real one, in a small
clone whose one package comes from an index of the test's own.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

import pytest
from programs import ROOT, begun, done, line_of

pytestmark = pytest.mark.system
INSTALL = ROOT / "launch_scripts" / "install"

LACKING_TWO = r"""
for name in "${@:4}"; do
  case $name in python3-actionlib) ;; rosbash) echo "config-files $name" ;; *) echo "installed $name" ;; esac
done
echo "dpkg-query: no packages found matching python3-actionlib" >&2
exit 1
"""


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    folder = tmp_path / "bin"
    folder.mkdir()
    return folder


def replace(programs: Path, name: str, script: str) -> None:
    (programs / name).write_text(f"#!/bin/bash\n{script}\n")
    (programs / name).chmod(0o755)


@pytest.fixture
def lacking(programs: Path) -> Path:
    """A machine whose root finds two packages missing."""
    replace(programs, "dpkg-query", LACKING_TWO)
    replace(programs, "id", "echo 0")
    return programs


def run_install(
    programs: Path, code: int | None, install: Path = INSTALL, *arguments: str
) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"PATH": f"{programs}:/usr/bin:/bin", "TMPDIR": str(programs.parent)}
    return done(install, *arguments, env=environment, stdin=subprocess.DEVNULL, code=code)


def test_without_root_or_sudo_it_names_what_is_missing(lacking: Path) -> None:
    replace(lacking, "id", "echo 1000")
    replace(lacking, "sudo", "exit 1")
    replace(lacking, "apt-get", f"touch {lacking}/called")
    assert run_install(lacking, 1).stderr == (
        "musselbed: these Debian packages are missing, and installing them takes root or sudo: "
        "run as root: apt-get install --no-install-recommends python3-actionlib rosbash\n"
    )
    assert not (lacking / "called").exists()


def test_without_network_or_package_it_updates_once_and_names_what_is_missing(lacking: Path) -> None:
    """Only what is missing is asked for, and from the lists at hand first."""
    asked = "install --yes --no-install-recommends python3-actionlib rosbash"
    noted = f'echo "$DEBIAN_FRONTEND $*" >>{lacking}/calls; echo "E: no network"; exit 100'
    replace(lacking, "apt-get", noted)
    (line,) = run_install(lacking, 1).stderr.splitlines()
    assert "is there a network?" in line
    assert "apt-get install --no-install-recommends python3-actionlib rosbash " in line
    calls = (lacking / "calls").read_text().splitlines()
    assert calls[0].endswith(asked) and all(call.startswith("noninteractive ") for call in calls)
    assert [call.split()[4] for call in calls] == ["install", "update"]
    assert "E: no network" in Path(line.rsplit("its log: ", 1)[1].rstrip(")\n")).read_text()
    replace(lacking, "apt-get", 'echo "E: Unable to locate package python3-actionlib"; exit 100')
    (line,) = run_install(lacking, 1).stderr.splitlines()
    assert re.search(r"no list of packages of \w+ \S+, \w+ has python3-actionlib\)", line)


def test_a_machine_without_debians_tools_is_told_so_and_an_unknown_option_is_refused(programs: Path) -> None:
    told = run_install(programs, 2, INSTALL, "--tests").stderr
    assert told == "use: launch_scripts/install [--mu | --test | --ros2]\n"
    for name in ("dirname", "flock", "mktemp", "rm"):
        (programs / name).symlink_to(f"/usr/bin/{name}")
    environment = {"PATH": str(programs), "TMPDIR": str(programs.parent)}
    told = done("/bin/bash", INSTALL, env=environment, code=1).stderr
    assert told == "musselbed: Debian 12 or 13 is needed: this machine has no dpkg-query\n"


@pytest.mark.skipif(Path(sys.prefix) != ROOT / ".venv", reason="these tests do not run in an installed .venv")
def test_an_installed_clone_has_nothing_to_do() -> None:
    ambient = dict.fromkeys(("PYTHONPATH", "PYTHONHOME", "ROS_PACKAGE_PATH"), "/nowhere")
    told = done(INSTALL, "--test", env=os.environ | ambient)
    assert (told.stdout, told.stderr) == ("", "")


def test_a_pipe_shows_steps_while_they_are_slow(lacking: Path, clone: Path) -> None:
    """One silent step: the first line that a pipe gets comes after ten seconds; here, after three."""
    replace(lacking, "dpkg-query", LACKING_TWO)
    install = clone / "launch_scripts/slow-install"
    text = INSTALL.read_text()
    assert text.count(" -ge 10 ]") == 1
    install.write_text(text.replace(" -ge 10 ]", " -ge 3 ]"))
    install.chmod(0o755)
    called = f"{lacking}/called"
    slow = f"echo 'Unpacking rosbash'; [ -e {called} ] || sleep 5; touch {called}; exit 100"
    replace(lacking, "apt-get", slow)
    assert re.search(r"^ +[345] s: Unpacking rosbash$", run_install(lacking, 1, install).stdout, re.MULTILINE)


@pytest.mark.parametrize(
    ("release", "programs_there", "line"),
    [
        ("14", {}, "--debian takes 12 or 13, not '14'"),
        ("13", {"id": "echo 1000"}, "a clean Debian takes root: sudo launch_scripts/test --debian 13"),
        (
            "12",
            {"id": "echo 0", "mmdebstrap": ":", "git": ":", "df": "echo Avail; echo 3100M"},
            "a clean Debian takes 8 GB in /var/tmp, where 3 GB are free",
        ),
        (
            "13",
            {
                "id": "echo 0",
                "git": ":",
                "df": "echo 9000M",
                "mmdebstrap": "echo 'E: no mirror there'; exit 1",
                "unshare": 'shift; "$@"',
                "apt-get": "echo 'Debian-Security main http://lab/sec'; echo 'Debian main http://lab/debian/'",
            },
            "mmdebstrap could not make a Debian 13 from http://lab/debian/: E: no mirror there",
        ),
        (
            "13",
            {
                "id": "echo 0",
                "git": ":",
                "df": "echo 9000M",
                "mmdebstrap": ":",
                "apt-get": "echo 'Lab main http://lab/own'",
            },
            "apt's lists here name no mirror of Debian: apt-get update",
        ),
    ],
)
def test_a_clean_debian_that_cannot_be_made_is_one_line(
    programs: Path, release: str, programs_there: dict[str, str], line: str
) -> None:
    for name, script in programs_there.items():
        replace(programs, name, script)
    environment = os.environ | {"PATH": f"{programs}:/usr/bin:/bin"}
    told = done(ROOT / "launch_scripts/test", "--debian", release, env=environment, code=2).stderr
    assert told == f"musselbed: {line}\n"


HTTPS = """
import functools, http.server, ssl, sys
folder, certificate, key = sys.argv[1:]
handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=folder)
server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
if certificate:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate, key)
    server.socket = context.wrap_socket(server.socket, server_side=True)
print(server.server_port, flush=True)
server.serve_forever()
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clone that asks PyPI for one package, tinypart. Its environment is made by the first test that installs there."""
    clone = tmp_path_factory.mktemp("made") / "clone"
    shutil.copytree(
        ROOT / "launch_scripts", clone / "launch_scripts", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copytree(ROOT / "apad_bridge/ros/types", clone / "apad_bridge/ros/types")
    shutil.copytree(ROOT / "apad_bridge/ros/definitions", clone / "apad_bridge/ros/definitions")
    shutil.copy(ROOT / "pyproject.toml", clone)
    (clone / "setup.cfg").write_text(
        "[options]\ninstall_requires =\n    tinypart>=1\n[options.extras_require]\nimc =\n"
    )
    (clone / "launch_scripts/needed-packages.bash").write_text(
        (ROOT / "launch_scripts/needed-packages.bash")
        .read_text()
        .replace("extras=studies,export,imc", "extras=imc")
    )
    return clone


@pytest.fixture
def clone(made: Path, programs: Path) -> Path:
    """The same on a machine that has all of Debian's packages."""
    replace(programs, "dpkg-query", 'for name in "${@:4}"; do echo "installed $name"; done')
    if (made / ".venv").exists():
        stamped(made)
    return made


def stamped(clone: Path) -> None:
    """Writes that the environment is of this place and interpreter, and its packages of an older installation."""
    version = done("/usr/bin/python3", "-V").stdout.strip()
    (clone / ".venv/share/musselbed").mkdir(parents=True, exist_ok=True)
    (clone / ".venv/share/musselbed/installed").write_text(f"{clone} {version}\nof an older install\n")


def write_wheel(index: Path, name: str, needs: str = "") -> bytes:
    """A package of version 1.0 in an index, and its bytes."""
    info, file = f"{name}-1.0.dist-info", index / "simple" / name / f"{name}-1.0-py3-none-any.whl"
    file.parent.mkdir(parents=True)
    parts = {
        f"{name}.py": "",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n{needs}",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/RECORD": "",
    }
    with zipfile.ZipFile(file, "w") as wheel:
        for part, text in parts.items():
            wheel.writestr(part, text)
    return file.read_bytes()


@contextmanager
def served(index: Path, certificate: Path | None = None) -> Iterator[int]:
    """The port of the loopback that serves the folder; by TLS with a certificate."""
    names = ("", "") if certificate is None else (certificate, certificate.with_suffix(".key"))
    program = (sys.executable, "-c", HTTPS, index, *names)
    with begun(*program, stderr=subprocess.DEVNULL, ends_by=signal.SIGKILL) as server:
        yield int(line_of(server))


def pin(clone: Path, hash_of: bytes) -> None:
    """Pins tinypart for Debian's Python by the hash of these bytes."""
    shown = "import sys; print('{}.{}'.format(*sys.version_info))"
    folder = clone / "launch_scripts" / "requirements" / done("/usr/bin/python3", "-c", shown).stdout.strip()
    folder.mkdir(exist_ok=True)
    (folder / "run.txt").write_text(f"tinypart==1.0 --hash=sha256:{sha256(hash_of).hexdigest()}\n")


def install_from(index: str, clone: Path, programs: Path, **variables: str) -> str:
    """What an installation from an index prints; it ends with one line of an error."""
    # requests, within pip, prefers the bundles to PIP_CERT.
    kept = {it: value for it, value in os.environ.items() if not re.match("PIP_|.*_CA_BUNDLE$", it)}
    environment = kept | {
        "PATH": f"{programs}:/usr/bin:/bin",
        "TMPDIR": str(programs.parent),
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_INDEX_URL": index,
        "PIP_RETRIES": "1",
        "no_proxy": "127.0.0.1,localhost",
        **variables,
    }
    install = clone / "launch_scripts/install"
    ended = done(install, env=environment, stdin=subprocess.DEVNULL, code=1)
    (line,) = ended.stderr.splitlines()
    assert line.startswith("musselbed: ") and Path(line.rsplit("its log: ", 1)[1].rstrip(")")).is_file()
    return ended.stdout + line


TLS, CLEAR = "https://localhost:PORT/simple", "http://127.0.0.1:PORT/simple"
UNTRUSTED = r"the certificate of localhost:\d+ is not trusted \(self-signed certificate\).*set PIP_CERT"
UNPINNED = (
    r"no versions are pinned for Python 3\.\d+ on riscv64: the newest within the bounds.*"
    r"the package index has no file of setuptools\S* for Python 3\.\d+ on riscv64"
)
FAULTS: dict[str, tuple[str, str, dict[str, str], str]] = {
    "another file than the pinned one": (
        "another file",
        CLEAR,
        {},
        "the file of tinypart==1.0 is not the one pinned in launch_scripts/requirements/.*do not trust the index",
    ),
    "a package without a pin is no tampering": (
        "the wheel",
        CLEAR,
        {},
        "run.txt does not pin otherpart, which another one needs(?!.*trust)",
    ),
    "a certificate that is not trusted": ("another file", TLS, {}, UNTRUSTED),
    "with the remedy that the line names": (
        "another file",
        TLS,
        {"PIP_CERT": "server.crt"},
        "is not the one pinned",
    ),
    "where that would be no remedy": (
        "another file",
        TLS,
        {"PIP_CERT": "server.crt", "REQUESTS_CA_BUNDLE": "other.crt"},
        "set REQUESTS_CA_BUNDLE to its certificate",
    ),
    "nobody serves": ("another file", "http://127.0.0.1:9/simple", {}, "127.0.0.1:9 refuses connections"),
    "no such machine": (
        "another file",
        "https://index.invalid/simple",
        {},
        r"index.invalid cannot be reached: is there a network\?",
    ),
    "a processor without pins takes what the bounds allow": (
        "another file",
        CLEAR,
        {"MACHINE": "riscv64"},
        f"(?s)^(?!.*trust).*{UNPINNED}",
    ),
}
"""What is pinned, the index, variables of the shell, and what is said."""


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a package index that has tinypart 1.0, which needs otherpart; and two certificates."""
    folder = tmp_path_factory.mktemp("index")
    (folder / "the wheel").write_bytes(write_wheel(folder, "tinypart", "Requires-Dist: otherpart\n"))
    (folder / "another file").touch()
    write_wheel(folder, "otherpart")
    request = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -addext subjectAltName=DNS:localhost"
    for it in ("server", "other"):
        done(*request.split(), "-out", folder / f"{it}.crt", "-keyout", folder / f"{it}.key")
    return folder


@pytest.mark.parametrize("name", FAULTS)
def test_an_index_from_which_nothing_can_be_installed_is_named(
    name: str, clone: Path, programs: Path, index: Path
) -> None:
    pinned, address, variables, said = FAULTS[name]
    pin(clone, (index / pinned).read_bytes())
    replace(programs, "uname", 'echo "${MACHINE:-x86_64}"')
    variables = {it: str(index / value) if "." in value else value for it, value in variables.items()}
    with served(index, index / "server.crt" if address == TLS else None) as port:
        printed = install_from(address.replace("PORT", str(port)), clone, programs, **variables)
    assert re.search(said, printed), printed


def test_an_environment_of_an_older_install_is_mended_and_keeps_the_users_packages(
    clone: Path, programs: Path, index: Path
) -> None:
    pin(clone, b"another file")
    environment = clone / ".venv"
    done("/usr/bin/python3", "-m", "venv", "--clear", "--system-site-packages", environment)
    (site,) = environment.glob("lib/*/site-packages")
    (site / "lab_strategies.py").touch()
    stamped(clone)
    with served(index) as port:
        printed = install_from(f"http://127.0.0.1:{port}/simple", clone, programs)
    assert printed.startswith(
        "mending .venv: it saw all Python packages of Debian's, and now sees those of ROS alone\n"
    )
    look = (
        "import lab_strategies, sys; from importlib.util import find_spec\n"
        "assert not any('dist-packages' in it for it in sys.path), sys.path\n"
        # Debian's genpy needs yaml, and a pinned package brings it.
        "assert find_spec('genpy') and not find_spec('yaml')"
    )
    done(environment / "bin/python", "-I", "-c", look)
