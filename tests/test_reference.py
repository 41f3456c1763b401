"""The API reference is made of the docstrings."""

import subprocess
import sys
from pathlib import Path

import hexakin as hk


def test_the_reference_has_a_page_for_each_public_module_and_the_docstrings_in_it(tmp_path):
    command = [sys.executable, Path(__file__).with_name("reference.py"), tmp_path]
    subprocess.run(command, check=True, capture_output=True, timeout=600)
    for name, place in hk.PUBLIC.items():
        page = tmp_path.joinpath(*place.partition(":")[0].split(".")).with_suffix(".html")
        assert page.stat().st_size > 1000, name
    page = (tmp_path / "hexakin.html").read_text(encoding="utf-8")
    assert "inverse_kinematics" in page and "Joint angles that bring the feet" in page
    steering = (tmp_path / "hexakin" / "control" / "steering.html").read_text(encoding="utf-8")
    assert "rise_duration" in steering and "<h6" in steering, "sections of numpy's docstrings are headings"
