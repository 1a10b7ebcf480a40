"""What the server is told, and what of it is refused."""

from pathlib import Path

import pytest

from app.settings import Settings, SettingsError


def test_a_token_is_made_anew_where_none_is_given(monkeypatch):
    monkeypatch.delenv("COVERNAV_TOKEN", raising=False)
    first, second = Settings.make().token, Settings.make().token
    assert first != second and len(first) >= 32


def test_the_environment_fills_in_what_was_left_out(monkeypatch):
    monkeypatch.setenv("COVERNAV_TOKEN", "from-outside")
    monkeypatch.setenv("COVERNAV_HOSTS", "studio.example, lab.local")
    settings = Settings.make(host="0.0.0.0", port=9000, workspace=Path("w"))
    assert settings.token == "from-outside" and settings.hosts == ("studio.example", "lab.local")
    assert Settings.make(token="given").token == "given"


def test_the_token_stays_out_of_representations():
    assert "hush-hush" not in repr(Settings.make(token="hush-hush"))


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"token": ""}, "token"),
        ({"token": "with space"}, "token"),
        ({"token": "naïve"}, "token"),
        ({"token": "x" * 201}, "token"),
        ({"host": "no host/here"}, "host"),
        ({"host": ""}, "host"),
        ({"port": 70000}, "port"),
        ({"hosts": ("bad name",)}, "hosts"),
        ({"colour": "red"}, "colour"),
    ],
)
def test_what_cannot_be_used_is_named(fields, reason):
    with pytest.raises(SettingsError, match=reason):
        Settings.make(**fields)
