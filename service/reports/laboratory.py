"""Settings of the laboratory that issues reports: a TOML file, and a logo in the same folder."""

from __future__ import annotations

import json
import struct
import tomllib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath, PureWindowsPath
from tempfile import TemporaryDirectory
from typing import Final, Literal

from pydantic import ValidationError

from jointstiff.schemas.report import Laboratory
from jointstiff.service.problems import ServiceError
from jointstiff.service.reports.document import NOT_STATED, Letterhead, Logo

MAX_SETTINGS_BYTES: Final = 64 * 1024
MAX_LOGO_BYTES: Final = 256 * 1024
MAX_LOGO_SIDE: Final = 2_000
"""Greatest width and height of a logo [pixels]: decompressed, a small file can fill the memory."""
_PNG: Final = b"\x89PNG\r\n\x1a\n"
_JPEG: Final = b"\xff\xd8\xff"
_JPEG_FRAMES: Final = frozenset((0xC0, 0xC1, 0xC2))
"""JPEG markers that are followed by the size of the image: baseline, extended, progressive."""


class SettingsError(ServiceError):
    """The settings cannot be used."""


@dataclass(frozen=True)
class LaboratorySettings:
    """The laboratory that issues reports, and its logo; both are None without settings."""

    laboratory: Laboratory | None = None  # content of the TOML file
    logo: Logo | None = None  # picture above the reports

    def letterhead(self) -> Letterhead:
        """Return the letterhead of a report: name, address, contact, accreditation and logo."""
        laboratory = self.laboratory
        if laboratory is None:
            return Letterhead(f"Laboratory: {NOT_STATED}", [])
        lines = (", ".join(laboratory.address), laboratory.contact, laboratory.accreditation)
        return Letterhead(laboratory.name, [line for line in lines if line], self.logo)


def read_laboratory(path: Path) -> LaboratorySettings:
    """Read the settings of a laboratory from a TOML file, and its logo from the same folder.

    Raises:
        SettingsError: the file or its logo cannot be read or used.
    """
    try:
        text = _read_limited(path, MAX_SETTINGS_BYTES).decode("utf-8")
        laboratory = Laboratory.model_validate(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"{path} is not TOML: {error}", "correct the file") from error
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, fault["loc"]))
        raise SettingsError(
            f"{path}: {place}: {fault['msg']}", "see docs/report.md for the fields"
        ) from error
    logo = None if laboratory.logo is None else _read_logo(path.parent, laboratory.logo)
    return LaboratorySettings(laboratory, logo)


def _read_limited(path: Path, max_bytes: int) -> bytes:
    """Return the content of a file.

    Raises:
        SettingsError: the file cannot be read, or has more than `max_bytes` bytes.
    """
    try:
        # One byte more than allowed shows that a file is too large; the size of a pipe is not known before.
        with path.open("rb") as file:
            content = file.read(max_bytes + 1)
    except OSError as error:
        raise SettingsError(
            f"cannot read {path}: {error.strerror}", "give the name of an existing file"
        ) from error
    if len(content) > max_bytes:
        raise SettingsError(f"{path} exceeds {max_bytes // 1024} KiB", "use a smaller file")
    return content


def _read_logo(folder: Path, name: str) -> Logo:
    """Read a logo, a PNG or JPEG file in the folder of the settings.

    Raises:
        SettingsError: the name is not a plain file name, or the file is no PNG or JPEG, or too large.
    """
    _refuse_file_elsewhere(folder, name)
    content = _read_limited(folder / name, MAX_LOGO_BYTES)
    _refuse_unsuitable_picture(content, name)
    kind: Literal["png", "jpg"] = "png" if content.startswith(_PNG) else "jpg"
    logo = Logo(content, kind)
    _refuse_undisplayable_logo(logo, name)
    return logo


def _refuse_file_elsewhere(folder: Path, name: str) -> None:
    """Refuse a logo that is not a file in the folder of the settings itself, because of its path or a link.

    Raises:
        SettingsError: names what is not allowed.
    """
    is_plain_name = name == PurePosixPath(name).name == PureWindowsPath(name).name
    if not is_plain_name or name in {".", ".."}:
        raise SettingsError(
            f"logo: {name!r} is not the name of a file", "put the logo into the folder of the settings"
        )
    if (folder / name).is_symlink():
        raise SettingsError(
            f"logo: {name!r} is a link", "copy the picture file itself into the folder of the settings file"
        )


def _refuse_unsuitable_picture(content: bytes, name: str) -> None:
    """Refuse a logo that is no PNG or JPEG picture, or has too many pixels.

    Raises:
        SettingsError: names what is not allowed.
    """
    size = _image_size(content)
    if size is None:
        raise SettingsError(
            f"logo: the file {name!r} is neither a PNG nor a JPEG picture",
            "convert the picture to PNG; SVG is refused",
        )
    if not 1 <= min(size) <= max(size) <= MAX_LOGO_SIDE:
        raise SettingsError(
            f"logo: the size of {name!r}, {size[0]} × {size[1]} pixels, is not allowed",
            f"reduce width and height to at most {MAX_LOGO_SIDE} pixels",
        )


def _refuse_undisplayable_logo(logo: Logo, name: str) -> None:
    """Raise `SettingsError` if Typst cannot show a logo; do nothing if Typst is not installed."""
    try:
        import typst
    except ImportError:
        return
    # A document with nothing but the logo.
    source = f'#image(bytes(json(bytes(sys.inputs.logo))), format: "{logo.kind}")'
    try:
        with TemporaryDirectory(prefix="jointstiff-report-") as empty:
            inputs = {"logo": json.dumps(list(logo.content))}
            typst.Compiler(source.encode(), root=empty, sys_inputs=inputs).compile(format="pdf")
    except typst.TypstError as error:
        raise SettingsError(
            f"logo: {name!r} cannot be shown: {error.message}", "save the picture again as PNG"
        ) from error


def _image_size(content: bytes) -> tuple[int, int] | None:
    """Return width and height [pixels] of a PNG or a JPEG; None for any other file."""
    if content.startswith(_PNG) and content[12:16] == b"IHDR" and len(content) >= 24:
        width, height = struct.unpack(">II", content[16:24])
        return width, height
    # A JPEG is a list of segments: 0xFF, a marker, and the length of the rest in two bytes. A frame segment
    # has height and width after the length and one more byte.
    position = 2 if content.startswith(_JPEG) else len(content)
    while position + 9 <= len(content) and content[position] == 0xFF:
        if content[position + 1] in _JPEG_FRAMES:
            height, width = struct.unpack(">HH", content[position + 5 : position + 9])
            return width, height
        position += 2 + max(int.from_bytes(content[position + 2 : position + 4], "big"), 2)
    return None
