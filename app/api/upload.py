"""A multipart form whose file goes straight to disk, however large, while small fields stay in memory."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from fastapi import HTTPException, Request
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header

if TYPE_CHECKING:
    from python_multipart.multipart import MultipartCallbacks

MAX_FIELDS = 16
MAX_FIELD_BYTES = 4096
MAX_NAME = 80


@dataclass
class Form:
    """What was sent: the file on disk and the other fields as text."""

    file: Path | None = None
    fields: dict[str, str] = field(default_factory=dict)


async def read_form(request: Request, folder: Path) -> Form:
    """Read a form with one `file`, written into `folder` under its own (harmless) name.

    Raises HTTPException: 415 for another kind of body, 422 for a form that is malformed or incomplete."""
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    if kind != b"multipart/form-data" or not options.get(b"boundary"):
        raise HTTPException(415, "the body must be multipart/form-data with the file in the field 'file'")
    reader = _FormReader(folder)
    try:
        parser = MultipartParser(options[b"boundary"], reader.callbacks())
        async for chunk in request.stream():
            parser.write(chunk)
        parser.finalize()
    except (FormParserError, UnicodeDecodeError):
        raise HTTPException(422, "the form is malformed: it must be multipart/form-data") from None
    finally:
        reader.close()
    if not reader.ended:
        raise HTTPException(422, "the form ends before its closing boundary")
    if reader.form.file is None:
        raise HTTPException(422, "file: is required: a GeoTIFF, LAS, LAZ or scenario JSON file")
    return reader.form


def harmless_name(filename: str) -> str:
    """The last part of a file name, without what a file system or a page could stumble on."""
    last = re.split(r"[/\\]", filename)[-1]
    name = re.sub(r"[^\w. ()+-]", "_", last).strip(". ")
    stem, dot, suffix = name.rpartition(".")
    if dot and len(suffix) <= 8:
        name = f"{stem[: MAX_NAME // 2]}.{suffix}"
    return name[:MAX_NAME].encode("ascii", "replace").decode().replace("?", "_") or "upload"


class _FormReader:
    """Callbacks of the parser: gathers a part's headers, then its data."""

    def __init__(self, folder: Path) -> None:
        self.form = Form()
        self.ended = False
        self._folder = folder
        self._stream: BinaryIO | None = None
        self._name = self._header = self._value = b""
        self._disposition = b""
        self._data = b""

    def callbacks(self) -> MultipartCallbacks:
        return {
            "on_part_begin": self._begin,
            "on_header_field": self._take_header,
            "on_header_value": self._take_value,
            "on_header_end": self._end_header,
            "on_headers_finished": self._open,
            "on_part_data": self._take_data,
            "on_part_end": self._finish,
            "on_end": self._end,
        }

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def _begin(self) -> None:
        self._disposition = self._data = b""

    def _take_header(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _take_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _end_header(self) -> None:
        if self._header.lower() == b"content-disposition":
            self._disposition = self._value
        self._header = self._value = b""

    def _open(self) -> None:
        _, options = parse_options_header(self._disposition)
        self._name = options.get(b"name", b"")
        filename = options.get(b"filename")
        if filename is None:
            return
        if self._name != b"file" or self.form.file is not None:
            raise HTTPException(422, "the form must hold one file, in the field 'file'")
        self.form.file = self._folder / harmless_name(filename.decode("utf-8", "replace"))
        self._stream = self.form.file.open("xb")

    def _take_data(self, data: bytes, start: int, end: int) -> None:
        if self._stream is not None:
            self._stream.write(data[start:end])
            return
        self._data += data[start:end]
        if len(self._data) > MAX_FIELD_BYTES:
            raise HTTPException(422, f"a field of the form is longer than {MAX_FIELD_BYTES} bytes")

    def _finish(self) -> None:
        if self._stream is not None:
            self.close()
            return
        self.form.fields[self._name.decode("utf-8", "replace")] = self._data.decode()
        if len(self.form.fields) > MAX_FIELDS:
            raise HTTPException(422, f"the form has more than {MAX_FIELDS} fields")

    def _end(self) -> None:
        self.ended = True
