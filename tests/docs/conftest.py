"""The practice folder, in which the commands of the guides run."""

import pytest
from click.testing import CliRunner

from frischid.cli import main


@pytest.fixture(scope="session")
def filled(tmp_path_factory):
    """The folder that the guides speak of."""
    folder = tmp_path_factory.mktemp("practice")
    result = CliRunner().invoke(main, ["demo", "--practice", str(folder / "practice")])
    assert result.exit_code == 0, result.output
    return folder / "practice"
