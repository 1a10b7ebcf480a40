"""Scenes: open, save, make and exchange scenarios."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import viser

from app.changes import Change
from app.view.desk import Desk, show_value
from scenes.scenario import Family

FAMILIES = {
    "normal": Family.NORMAL,
    "low": Family.LOW,
    "low to high": Family.LOW_HIGH,
    "forest": Family.FOREST,
}
LARGEST_SEED = 2**31 - 1


class ScenariosTab:
    def __init__(self, desk: Desk) -> None:
        self._desk, self._studio = desk, desk.studio
        gui, studio = desk.gui, desk.studio
        self._ids: dict[str, str] = {}
        self._list: Any = gui.add_dropdown("Scenario", ("…",))
        choose = gui.add_button_group("", ("Open", "Delete"))
        desk.on_choice(choose, {"Open": self._open, "Delete": self._delete})
        self._name = gui.add_text("Name", studio.scenario.name)
        keep = gui.add_button_group("", ("Save", "Save as", "Duplicate"))
        desk.on_choice(keep, {"Save": studio.save, "Save as": self._save_as, "Duplicate": studio.duplicate})
        with gui.add_folder("New from the generator"):
            self._family = gui.add_dropdown("Terrain", tuple(FAMILIES))
            self._seed = gui.add_number("Seed", 1, min=0, max=LARGEST_SEED, step=1)
            self._size = gui.add_number("Size (m)", 48, min=24, max=128, step=4)
            desk.on_click(gui.add_button("Generate", icon=viser.Icon.WAND), self._generate)
        with gui.add_folder("Exchange"):
            self._upload = gui.add_upload_button(
                "Upload scenario, GeoTIFF or LAS/LAZ", icon=viser.Icon.UPLOAD
            )
            self._crop = gui.add_number(
                "Crop to (m, 0: all)",
                0,
                min=0,
                max=1000,
                step=10,
                hint="Side of the square to cut out of a survey",
            )
            self._crop_x = gui.add_number(
                "Crop centre x", 0.0, step=1.0, hint="Easting, or metres east of the survey's middle"
            )
            self._crop_y = gui.add_number(
                "Crop centre y", 0.0, step=1.0, hint="Northing, or metres north of the survey's middle"
            )
            self._scale = gui.add_number("Vertical scale", 1.0, min=0.01, max=100.0, step=0.1)
            download = gui.add_button("Download this scenario", icon=viser.Icon.DOWNLOAD)
        self._receive()
        desk.on_click(download, self._download)
        self._list_scenarios()

    def refresh(self, change: Change) -> None:
        if change in (Change.OPENED, Change.LIBRARY):
            self._list_scenarios()
        if change is not Change.EDITED:
            show_value(self._name, self._studio.scenario.name)

    def _list_scenarios(self) -> None:
        self._ids = {}
        for entry in self._studio.library():
            label = entry.name if entry.shipped else f"{entry.name} (saved)"
            if label in self._ids:
                label = f"{label} [{entry.id}]"
            self._ids[label] = entry.id
        if not self._ids:
            return
        labels = tuple(self._ids)
        if tuple(self._list.options) != labels:
            self._list.options = labels
        current = next(
            (label for label, number in self._ids.items() if number == self._studio.scenario_id), None
        )
        if current is not None:
            show_value(self._list, current)

    def _chosen(self) -> str:
        return str(self._ids.get(self._list.value, self._list.value))

    async def _open(self) -> None:
        await self._with_note("Opening", self._list.value, self._studio.open(self._chosen()))

    def _delete(self) -> None:
        self._studio.delete(self._chosen())

    def _save_as(self) -> None:
        self._studio.save_as(self._name.value.strip())

    async def _generate(self) -> None:
        family = FAMILIES.get(self._family.value, self._family.value)
        making = self._studio.generate(family, int(self._seed.value), float(self._size.value))
        await self._with_note("New terrain", f"{self._family.value}, seed {int(self._seed.value)}", making)

    def _receive(self) -> None:
        @self._upload.on_upload
        async def _(event: viser.GuiEvent) -> None:
            self._desk.post(self._import, event.target.value)

    async def _import(self, file: viser.UploadedFile) -> None:
        options: dict[str, Any] = {}
        if not file.name.lower().endswith(".json"):
            options = {"vertical_scale": float(self._scale.value)}
            if self._crop.value > 0:
                options["crop"] = (
                    float(self._crop_x.value),
                    float(self._crop_y.value),
                    float(self._crop.value),
                )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"upload{Path(file.name).suffix[:10]}"
            path.write_bytes(file.content)
            reading = self._studio.import_file(path, file.name, **options)
            await self._with_note("Importing", file.name[:80], reading)

    async def _with_note(self, title: str, words: str, work) -> None:
        note = self._desk.progress(title, words)
        try:
            await work
        finally:
            note.remove()

    def _download(self) -> None:
        document = self._studio.scenario.to_json().encode()
        name = f"{self._studio.scenario_id}.json"
        self._desk.viewer.client.send_file_download(name, document, save_immediately=True)
