"""Settings of laboratories: what is taken, and what is refused."""

import struct

import pytest
from support.terminal import terminal

from jointstiff.service.reports.laboratory import SettingsError, read_laboratory

SVG = b'<svg xmlns="http://www.w3.org/2000/svg"><script>alert(1)</script></svg>'


def png(width, height, size=64):
    return b"\x89PNG\r\n\x1a\n" + b"\0\0\0\rIHDR" + struct.pack(">II", width, height) + bytes(size)


def jpeg(width, height):
    return b"\xff\xd8\xff\xe0\0\x04ab\xff\xc0\0\x11\x08" + struct.pack(">HH", height, width) + bytes(16)


def written(folder, logo=None, content=b"", text='name = "Lab"\n'):
    if logo is not None:
        text += f"logo = {logo!r}\n"
        if "/" not in logo and "\\" not in logo and logo not in {".", ".."}:
            (folder / logo).write_bytes(content)
    path = folder / "lab.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("logo", "content", "reason"),
    [
        ("../../etc/passwd", b"", "not the name of a file"),
        ("/etc/passwd", b"", "not the name of a file"),
        ("..\\secret.png", b"", "not the name of a file"),
        ("..", b"", "not the name of a file"),
        ("logo.svg", SVG, "neither a PNG nor a JPEG picture"),
        ("logo.png", SVG, "neither a PNG nor a JPEG picture"),
        ("logo.png", png(10, 10, 10_000_000), "exceeds 256 KiB"),
        ("logo.png", png(100_000, 100_000), "100000 × 100000 pixels"),
        ("logo.jpg", jpeg(3000, 10), "3000 × 10 pixels"),
        ("logo.png", png(0, 10), "0 × 10 pixels"),
        ("logo.png", png(10, 10), "cannot be shown"),
    ],
)
def test_other_logos_are_refused(tmp_path, logo, content, reason):
    with pytest.raises(SettingsError, match=reason):
        read_laboratory(written(tmp_path, logo, content))


def test_links_are_refused(tmp_path):
    path = written(tmp_path, "real.png", png(10, 10))
    (tmp_path / "logo.png").symlink_to(tmp_path / "real.png")
    path.write_text('name = "Lab"\nlogo = "logo.png"\n')
    with pytest.raises(SettingsError, match="is a link"):
        read_laboratory(path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(SettingsError, match="cannot read"):
        read_laboratory(tmp_path / "lab.toml")


def test_the_service_does_not_start_with_settings_it_cannot_use(tmp_path):
    path = written(tmp_path, "logo.svg", SVG)
    shown = terminal("serve", "--port", "0", "--laboratory", str(path))
    assert shown.exit_code == 2
    assert "neither a PNG nor a JPEG picture" in shown.output
    assert "SVG is refused" in shown.output
