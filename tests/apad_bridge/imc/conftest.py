from pathlib import Path

import pytest
from imc_codec import Codec


@pytest.fixture(scope="session")
def codec(tmp_path_factory: pytest.TempPathFactory) -> Codec:
    """The independent codec."""
    return Codec(tmp_path_factory.mktemp("imc"))


@pytest.fixture(scope="session")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The directory of a short run of the pool in virtual time, at theta 30, which has ended."""
    import yaml

    from apad_bridge.commands import main

    root = Path(__file__).parents[3]
    data = yaml.safe_load((root / "launch_scripts/scenarios/pool-12.yaml").read_text())
    data.update(name="imc", duration_s=400, theta=30)
    data["fleet"].update(count=6, start={"charge": [0.5, 0.75]}, hosting="one_process")
    folder = tmp_path_factory.mktemp("flown")
    (folder / "imc.yaml").write_text(yaml.safe_dump(data))
    out = folder / "run"
    assert main.main(["run", str(folder / "imc.yaml"), "--time", "asap", "--out", str(out), "--json"]) == 0
    return out
