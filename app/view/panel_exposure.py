"""Routes and exposure: what the overlay shows, how exposed the drive is, routes side by side, and why."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import viser

from app.changes import Change
from app.exposure_fields import Over
from app.exposure_service import Picture
from app.studio import Studio
from app.view import markup, palette
from app.view.desk import Desk, show_value
from app.view.exposure_paint import MOST_COUNTED, Show, likeliest
from app.view.plots import profile_svg, timeline_svg
from app.view.tools import Tool
from app.wording import listed
from planner.covert_route import CovertRoute
from planner.exposure import SightProfile
from planner.exposure_log import NOTICEABLE
from planner.frames import Exposure, Frame
from scenes.scenario import Observer

ROUTE_WORDS = {"route_shortest": "Shortest", "route_balanced": "Balanced", "route": "Most hidden"}
SHOWS = {"anybody sees": Show.UNITED, "how many see": Show.COUNT, "mean over patrols": Show.AVERAGED}
BELIEF_WORDS = "belief: who may lurk"
MOST_LISTED = 8
PLOTTED = 300  # points of the timeline
POSTS = ("1", "2", "3", "4")


class ExposureTab:
    def __init__(self, desk: Desk) -> None:
        self._desk, self._studio = desk, desk.studio
        self._show = show = desk.viewer.view.exposure
        gui = desk.gui
        self._choice = gui.add_dropdown("Ground shows", tuple(self._choices()))
        desk.on_value(self._choice, self._choose)
        self._alone = gui.add_checkbox("Selected observer alone", show.alone)
        desk.on_value(self._alone, lambda alone: show.show_alone(bool(alone)))
        self._legend = gui.add_html("")
        self._numbers = gui.add_html("")
        with gui.add_folder("Routes side by side"):
            self._routes = gui.add_html("")
            compare = gui.add_button("Compare routes from here", icon=viser.Icon.ROUTE)
            desk.on_click(compare, show.routes.compare)
            self._follow = gui.add_button_group("Follow", tuple(ROUTE_WORDS.values()), visible=False)
            desk.on_choice(
                self._follow,
                {words: (lambda name=name: show.follow(name)) for name, words in ROUTE_WORDS.items()},
            )
        with gui.add_folder("Why, and where else"):
            explain = gui.add_button("Explain a place (E)", icon=viser.Icon.ZOOM_QUESTION)
            desk.on_click(explain, lambda: desk.viewer.arm(Tool.EXPLAIN))
            self._why = gui.add_html("")
            posts = gui.add_button_group("Best watchers", POSTS)
            desk.on_choice(posts, {n: (lambda n=n: show.find_posts(int(n))) for n in POSTS})
            self._posts = gui.add_html("")
            self._occupy = gui.add_button("Post them as observers", visible=False)
            desk.on_click(self._occupy, show.occupy_posts)
            refuge = gui.add_button("Nearest hiding place", icon=viser.Icon.SHIELD)
            desk.on_click(refuge, show.find_refuge)
            self._refuge = gui.add_html("")
            self._hide = gui.add_button("Drive there", visible=False)
            desk.on_click(self._hide, show.drive_to_refuge)
        self._told: dict[int, str] = {}
        self.refresh(Change.OPENED)

    def _choices(self) -> dict[str, tuple[Show, int | None]]:
        """What the overlay can show, by its words."""
        choices: dict[str, tuple[Show, int | None]] = {words: (show, None) for words, show in SHOWS.items()}
        for observer in self._studio.scenario.observers:
            words = f"{called(observer)} sees"
            choices[words if words not in choices else f"{words} ({observer.id})"] = Show.UNITED, observer.id
        choices[BELIEF_WORDS] = Show.BELIEF, None
        return choices

    def _choose(self, words: str) -> None:
        choice = self._choices().get(words)
        if choice is not None:
            self._show.choose(*choice)

    def refresh(self, change: Change) -> None:
        """Show what has changed."""
        if change in (Change.OPENED, Change.EDITED, Change.EXPOSURE):
            choices = self._choices()
            if tuple(self._choice.options) != tuple(choices):
                self._choice.options = tuple(choices)
            wish = self._show.wish
            wished = (words for words, choice in choices.items() if choice == (wish.show, wish.observer))
            show_value(self._choice, next(wished, next(iter(choices))))
            show_value(self._alone, self._show.alone)
        if change is not Change.FRAME:
            self._tell(self._legend, self._ground())
        if change in (Change.OPENED, Change.ROUTES, Change.SETTINGS):
            self._refresh_routes()
        if change in (Change.OPENED, Change.EXPOSURE):
            self._tell(self._why, explanation(self._show.place, self._show.profiles, self._names()))
        if change in (Change.OPENED, Change.FRAME, Change.STATUS):
            self._tell(self._numbers, drive_numbers(self._studio, self._names()))

    def _refresh_routes(self) -> None:
        show = self._show
        comparison = show.routes.comparison
        routes = comparison.routes if comparison is not None else {}
        if comparison is not None and comparison.reason:
            words = markup.block(markup.sentence(f"No route: {comparison.reason}."))
        else:
            words = routes_table(routes, self._studio.method) if routes else ""
        if show.routes.working:
            words += markup.block(markup.sentence("working out the routes …"))
        self._tell(self._routes, words)
        self._follow.visible = bool(routes)
        self._occupy.visible = bool(show.posts)
        self._hide.visible = show.refuge is not None
        posts = [
            (f"at ({p.x:.1f}, {p.y:.1f}) m", f"sees {p.seen:.0%}, adds {p.adds:.0%}") for p in show.posts
        ]
        self._tell(self._posts, markup.block(markup.table(posts)) if posts else "")
        way = show.refuge
        if way is None:
            words = ""
        elif way.length_m < 0.5:
            words = markup.block(markup.sentence("The robot is hidden where it is."))
        else:
            rows = [("Away", f"{way.length_m:.1f} m"), ("Exposed on the way", f"{way.exposed_s:.1f} s")]
            words = markup.block(markup.table(rows))
        self._tell(self._refuge, words)

    def _names(self) -> dict[int, str]:
        return {observer.id: called(observer) for observer in self._studio.scenario.observers}

    def _ground(self) -> str:
        """The scale of what the overlay shows, and how much of the ground that is."""
        shown, picture, names = self._show.shown, self._show.picture, self._names()
        counting = shown.show is Show.COUNT and shown.observer is None
        if shown.show is Show.BELIEF:
            return self._belief_scale(picture)
        if counting:
            keys = "".join(
                markup.chip(tuple(colour), words)
                for colour, words in zip(
                    palette.count_colours(MOST_COUNTED).tolist(), ("0", "1", "2", "3", "4", "5+"), strict=True
                )
            )
        else:
            keys = markup.chip(palette.HIDDEN, "hidden") + markup.chip(palette.SEEN, "seen")
        keys += markup.chip(palette.UNKNOWN, "no data")
        if picture is None:
            return markup.block(keys)
        field = picture.field
        if shown.observer in field.observer_ids:
            seen, who = field.of(int(shown.observer or 0)), names.get(int(shown.observer or 0), "")
        else:
            seen, who = field.united, "anybody"
        rows = [(f"Seen by {who}", f"{field.share(seen):.0%} of the ground, {field.area(seen):.0f} m²")]
        if field.unknown.any():
            rows.append(("Without data", f"{field.unknown_area:.0f} m²"))
        return markup.block(keys, markup.table(rows))

    def _belief_scale(self, picture: Picture | None) -> str:
        """What the colours of the belief mean."""
        stops = [tuple(colour) for colour in palette.exposure_colours(np.linspace(0.0, 1.0, 5)).tolist()]
        most = likeliest(picture.field) if picture is not None and picture.over is Over.BELIEF else None
        return markup.block(
            markup.sentence("Chance that an observer whom nobody has told of, and nobody has seen, sees it"),
            markup.scale(stops, "0 %", "…" if most is None else f"{most:.0%}"),
        )

    def _tell(self, handle: viser.GuiHtmlHandle, content: str) -> None:
        if self._told.get(id(handle)) != content:
            self._told[id(handle)] = content
            handle.content = content


def called(observer: Observer) -> str:
    """What people call an observer."""
    unknown = "" if observer.known else " (unknown)"
    return f"{observer.name or f'observer {observer.id}'}{unknown}"


def drive_numbers(studio: Studio, names: dict[int, str]) -> str:
    """How exposed the drive is and was: a sentence, numbers, a plot over time, and each observer's share."""
    frame = studio.frame
    if frame is None or not names:
        return markup.block(markup.sentence("Nobody watches." if not names else "Not driven yet."))
    now = frame.exposure
    return markup.block(
        markup.sentence(sight_sentence(now, names)),
        timeline_svg(*studio.timeline.curves(PLOTTED)),
        markup.chip(palette.SEEN, "visible share") + markup.chip((206, 178, 226), "probability of detection"),
        markup.table(_totals(frame)),
        markup.grid(
            ("", "now", "exposed", "longest", "detected"),
            [
                (
                    names.get(watch.observer_id, f"observer {watch.observer_id}"),
                    f"{watch.fraction:.0%}",
                    f"{watch.exposed_s:.1f} s",
                    f"{watch.longest_exposure_s:.1f} s",
                    f"{watch.detection_probability:.0%}",
                )
                for watch in now.watches[:MOST_LISTED]
            ],
        ),
    )


def sight_sentence(now: Exposure, names: dict[int, str]) -> str:
    """Whether the robot is seen now, and by whom."""
    seen = [names.get(w.observer_id, "") for w in now.watches if w.fraction > NOTICEABLE]
    if not seen:
        return "Hidden from every observer."
    return f"{now.fraction:.0%} of the robot is seen, by {listed(seen)}."


def _totals(frame: Frame) -> list[tuple[str, str]]:
    now = frame.exposure
    expected = now.expected_detection_s
    return [
        ("Exposed", f"{now.exposed_s:.1f} s, {now.exposure_fraction:.0%} of the time"),
        ("Longest without a break", f"{now.longest_exposure_s:.1f} s"),
        ("Probability of detection", f"{now.detection_probability:.1%}"),
        ("Expected, if detected, after", "–" if expected is None else f"{expected:.1f} s"),
        ("Concealed", f"{now.concealed_fraction:.0%} of the time"),
        ("In cover (Algorithm 1)", f"{frame.metrics.cover_fraction:.0%} of the way"),
        ("Elevation gradient, summed", f"{frame.metrics.elevation_gradient_m:.2f} m"),
    ]


def routes_table(routes: dict[str, CovertRoute], method: str) -> str:
    """The compared routes in columns; the one that is followed stands out."""
    rows = []
    for name, words in ROUTE_WORDS.items():
        if name in routes:
            route = routes[name]
            rows.append((
                markup.Marked(words, palette.ROUTES[name], name == method),
                f"{route.length_m:.1f} m",
                f"{route.exposed_s:.1f} s",
                f"{route.longest_exposure_s:.1f} s",
                f"{route.detection_probability:.0%}",
            ))  # fmt: skip
    waits = [
        f"{until - since:.0f} s" for route in routes.values() for _, since, until in route.waits
    ]
    extra = markup.sentence(f"Waits in cover on the most hidden: {listed(waits)}.") if waits else ""
    return markup.block(markup.grid(("", "length", "exposed", "longest", "detected"), rows), extra)


def explanation(
    place: tuple[float, float] | None, profiles: Iterable[SightProfile], names: dict[int, str]
) -> str:
    """For a place: who sees it and why, with the section under the most telling line."""
    if place is None:
        return ""
    profiles = sorted(profiles, key=lambda profile: (not profile.seen, profile.point is None))
    seen = [names.get(profile.observer_id, "") for profile in profiles if profile.seen]
    verdict = f"seen by {listed(seen)}" if seen else "hidden from everybody" if profiles else "nobody watches"
    parts = [markup.sentence(f"({place[0]:.1f}, {place[1]:.1f}) m: {verdict}.")]
    for profile in profiles[:MOST_LISTED]:
        hidden = palette.UNKNOWN if profile.point is None else palette.HIDDEN
        colour = palette.SEEN if profile.seen else hidden
        parts.append(markup.key(colour, f"{names.get(profile.observer_id, '')}: {profile.reason}", height=8))
    parts += [profile_svg(profile) for profile in profiles[:2]]
    if len(profiles) > MOST_LISTED:
        parts.append(markup.sentence(f"and {len(profiles) - MOST_LISTED} more observers"))
    return markup.block(*parts)
