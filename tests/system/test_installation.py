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
    noted = f'echo "$DEBIAN_FRONTEND $*" >>{lacking}/calls; echo "E: no network"; exit 100'
    replace(lacking, "apt-get", noted)
    (line,) = run_install(lacking, 1).stderr.splitlines()
    assert "is there a network?" in line
    assert "apt-get install --no-install-recommends python3-actionlib rosbash " in line
    calls = (lacking / "calls").read_text().splitlines()
    assert [call.split()[4] for call in calls] == ["install", "update"]
    assert all(call.startswith("noninteractive ") for call in calls)
    assert calls[0].endswith("install --yes --no-install-recommends python3-actionlib rosbash")
    log = Path(line.rsplit("its log: ", 1)[1].rstrip(")\n"))
    assert "E: no network" in log.read_text()
    replace(lacking, "apt-get", 'echo "E: Unable to locate package python3-actionlib"; exit 100')
    (line,) = run_install(lacking, 1).stderr.splitlines()
    assert re.search(r"no list of packages of \w+ \S+, \w+ has python3-actionlib\)", line)


def test_a_machine_without_debians_tools_is_told_so(programs: Path) -> None:
    for name in ("dirname", "flock", "mktemp", "rm"):
        (programs / name).symlink_to(f"/usr/bin/{name}")
    environment = {"PATH": str(programs), "TMPDIR": str(programs.parent)}
    told = done("/bin/bash", INSTALL, env=environment, code=1).stderr
    assert told == "musselbed: Debian 12 or 13 is needed: this machine has no dpkg-query\n"


def test_an_unknown_option_is_refused(programs: Path) -> None:
    told = run_install(programs, 2, INSTALL, "--tests").stderr
    assert told == "use: launch_scripts/install [--mu | --test | --ros2]\n"


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


@pytest.fixture
def index(tmp_path: Path) -> Path:
    """The folder of a package index that has tinypart 1.0, which needs a package otherpart."""
    files = tmp_path / "index" / "simple" / "tinypart"
    files.mkdir(parents=True)
    with zipfile.ZipFile(files / "tinypart-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr("tinypart.py", "")
        wheel.writestr(
            "tinypart-1.0.dist-info/METADATA",
            "Metadata-Version: 2.1\nName: tinypart\nVersion: 1.0\nRequires-Dist: otherpart\n",
        )
        wheel.writestr(
            "tinypart-1.0.dist-info/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        wheel.writestr("tinypart-1.0.dist-info/RECORD", "")
    return tmp_path / "index"


@contextmanager
def served(index: Path, certificate: Path | None = None) -> Iterator[int]:
    """The port of the loopback that serves the folder; by TLS with a certificate."""
    names = ("", "") if certificate is None else (certificate, certificate.with_suffix(".key"))
    program = (sys.executable, "-c", HTTPS, index, *names)
    with begun(*program, stderr=subprocess.DEVNULL, ends_by=signal.SIGKILL) as server:
        yield int(line_of(server))


def pin(clone: Path, hash_of: bytes) -> None:
    """Pins tinypart for Debian's Python by the hash of these bytes."""
    python = done(
        "/usr/bin/python3", "-c", "import sys; print('{}.{}'.format(*sys.version_info))"
    ).stdout.strip()
    folder = clone / "launch_scripts" / "requirements" / python
    folder.mkdir(exist_ok=True)
    (folder / "run.txt").write_text(f"tinypart==1.0 --hash=sha256:{sha256(hash_of).hexdigest()}\n")


def install_from(index: str, clone: Path, programs: Path, **variables: str) -> str:
    """What an installation from an index prints; it ends with one line of an error."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")}
    # requests, within pip, prefers these to PIP_CERT.
    kept = {name: value for name, value in kept.items() if not name.endswith("_CA_BUNDLE")}
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


def test_a_file_that_is_not_the_pinned_one_is_called_that(clone: Path, programs: Path, index: Path) -> None:
    pin(clone, b"another file")
    with served(index) as port:
        line = install_from(f"http://127.0.0.1:{port}/simple", clone, programs)
    assert "the file of tinypart==1.0 is not the one pinned in launch_scripts/requirements/" in line
    assert "do not trust the index" in line


def test_a_package_without_a_pin_is_no_tampering(clone: Path, programs: Path, index: Path) -> None:
    pin(clone, (index / "simple/tinypart/tinypart-1.0-py3-none-any.whl").read_bytes())
    (index / "simple/otherpart").mkdir()
    with zipfile.ZipFile(index / "simple/otherpart/otherpart-1.0-py3-none-any.whl", "w") as wheel:
        wheel.writestr(
            "otherpart-1.0.dist-info/METADATA", "Metadata-Version: 2.1\nName: otherpart\nVersion: 1.0\n"
        )
    with served(index) as port:
        line = install_from(f"http://127.0.0.1:{port}/simple", clone, programs)
    assert "run.txt does not pin otherpart, which another one needs" in line
    assert "trust" not in line


def test_a_certificate_that_is_not_trusted_is_named(clone: Path, programs: Path, index: Path) -> None:
    pin(clone, b"")
    certificate, other = index / "server.crt", index / "other.crt"
    request = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost -addext subjectAltName=DNS:localhost"
    for it in (certificate, other):
        done(*request.split(), "-out", it, "-keyout", it.with_suffix(".key"))
    with served(index, certificate) as port:
        address = f"https://localhost:{port}/simple"
        line = install_from(address, clone, programs)
        assert f"the certificate of localhost:{port} is not trusted (self-signed certificate)" in line
        assert "set PIP_CERT" in line
        # The remedy that the line names.
        assert "is not the one pinned" in install_from(address, clone, programs, PIP_CERT=str(certificate))
        # With REQUESTS_CA_BUNDLE it would be none.
        elsewhere = {"PIP_CERT": str(certificate), "REQUESTS_CA_BUNDLE": str(other)}
        assert "set REQUESTS_CA_BUNDLE to its certificate" in install_from(
            address, clone, programs, **elsewhere
        )


def test_an_index_that_cannot_be_reached_is_named(clone: Path, programs: Path, index: Path) -> None:
    pin(clone, b"")
    with served(index) as port:
        pass
    line = install_from(f"http://127.0.0.1:{port}/simple", clone, programs)
    assert f"127.0.0.1:{port} refuses connections" in line
    line = install_from("https://index.invalid/simple", clone, programs)
    assert "index.invalid cannot be reached: is there a network?" in line


def test_a_processor_without_pins_takes_what_the_bounds_allow(
    clone: Path, programs: Path, index: Path
) -> None:
    pin(clone, b"another file")
    replace(programs, "uname", "echo riscv64")
    with served(index) as port:
        printed = install_from(f"http://127.0.0.1:{port}/simple", clone, programs)
    assert re.search(
        r"no versions are pinned for Python 3\.\d+ on riscv64: the newest within the bounds", printed
    )
    assert re.search(r"the package index has no file of setuptools\S* for Python 3\.\d+ on riscv64", printed)
    assert "trust" not in printed


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
