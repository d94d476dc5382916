"""Make pictures of README and of the first page of the site: docs/soft.png, docs/pendulum.png.

python docs/readme_pictures.py
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent


def scene():
    """The scene that README shows."""
    found = re.search(r"^```toml\n(.*?)^```", (DOCS.parent / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    assert found is not None
    return found[1]


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "soft.toml").write_text(scene())
        for name in ("soft.toml", "pendulum"):
            picture = DOCS / f"{Path(name).stem}.png"
            command = [sys.executable, "-m", "rig", "simulate", name, "--figure", str(picture), "--force"]
            subprocess.run(command, cwd=folder, check=True)
