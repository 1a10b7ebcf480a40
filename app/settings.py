"""What `covernav serve` is told: where to listen, where to keep things, who may come in."""

from __future__ import annotations

import os
import secrets
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from scenes.scenario import first_message

TOKEN_VARIABLE = "COVERNAV_TOKEN"
HOSTS_VARIABLE = "COVERNAV_HOSTS"

HostName = Annotated[str, Field(pattern=r"^[A-Za-z0-9._:\-\[\]]{1,253}$")]


class SettingsError(ValueError):
    """A setting that cannot be used, in one sentence."""


class Settings(BaseModel):
    """Settings of the server.

    host : address or name to listen on; port : 0 takes a free one
    workspace : folder of saved scenarios and runs
    token : what a visitor must know; made anew at every start unless given
    hosts : further names under which browsers reach this server, e.g. behind a reverse proxy
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    host: HostName = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8000
    workspace: Path = Path("~/.covernav")
    token: Annotated[str, Field(pattern=r"^[\x21-\x7e]{1,200}$", repr=False)]
    hosts: tuple[HostName, ...] = ()

    @classmethod
    def make(cls, *, token: str | None = None, **fields: Any) -> Settings:
        """Fill in from the environment what was left out: COVERNAV_TOKEN, and COVERNAV_HOSTS with names
        between commas. Raises SettingsError."""
        if token is None:
            token = os.environ.get(TOKEN_VARIABLE) or secrets.token_urlsafe(24)
        hosts = tuple(name.strip() for name in os.environ.get(HOSTS_VARIABLE, "").split(",") if name.strip())
        try:
            return cls.model_validate({"token": token, "hosts": hosts} | fields)
        except ValidationError as error:
            raise SettingsError(_in_words(error)) from None


def _in_words(error: ValidationError) -> str:
    field = error.errors()[0]["loc"][0]
    match field:
        case "token":
            return "the token must be 1 to 200 visible ASCII characters without spaces"
        case "host" | "hosts":
            return f"{field} must be a name or an address such as 127.0.0.1"
    return first_message(error)
