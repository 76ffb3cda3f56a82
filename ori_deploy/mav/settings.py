"""Settings of the component (TOML, schema ori-deploy/mavlink/1). Every key has a default."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import Field, StringConstraints

from ori_deploy.errors import FileError, InputError
from ori_deploy.files.profile_spec import Strict
from ori_deploy.files.text import read_toml, validated
from ori_deploy.mav.link_spec import LinkSpec, parse_link

MAVLINK_SCHEMA = "ori-deploy/mavlink/1"

DeployWhen = Literal["always", "disarmed", "on-ground", "on-ground-and-disarmed"]
DEPLOY_RULES: tuple[DeployWhen, ...] = get_args(DeployWhen)
"""In the order of the parameter ORI_DEPLOY_WHEN."""

LinkLoss = Literal["finish", "hold"]
MOST_LINKS = 8
LEAST_LINK_TIMEOUT_S = 2.0
"""Stations have a heartbeat a second: with less, the first that is late would hold a motion."""


@dataclass(frozen=True)
class Settings:
    """Of the component on the vehicle's network.

    Attributes
    ----------
    system_id, component_id
        The vehicle, and this component in it; by default MAVLink's SERVO1.
    autopilot_component
        Component of the same system whose word on arming and landing counts.
    links
        Where it is heard and hears.
    beyond_loopback
        Whether links may listen where other machines reach them.
    commanders
        System ids that may command and set parameters.
    deploy_when
        What the vehicle has to be doing before the structure deploys.
    force_allowed
        Whether a command's force goes past that, and past what folding needs.
    link_loss, link_timeout_s
        What becomes of a motion whose station fell silent, and after how long a silence.
    facts_fresh_s
        How old the autopilot's word may be.
    telemetry_hz
        Of creases and latches.
    key_file, accept_unsigned
        Key of MAVLink's signatures, and whether unsigned frames are believed beside it.
    parameters_file
        Where parameters last that a station has set.
    """

    system_id: int = 1
    component_id: int = 140
    autopilot_component: int = 1
    links: tuple[LinkSpec, ...] = ()
    beyond_loopback: bool = False
    commanders: tuple[int, ...] = (255,)
    deploy_when: DeployWhen = "disarmed"
    force_allowed: bool = False
    link_loss: LinkLoss = "hold"
    link_timeout_s: float = 3.0
    facts_fresh_s: float = 2.0
    telemetry_hz: float = 4.0
    key_file: Path | None = None
    accept_unsigned: bool = False
    parameters_file: Path | None = None


_Id = Annotated[int, Field(strict=True, ge=1, le=255)]
_FileName = Annotated[str, StringConstraints(strict=True, min_length=1, pattern=r"^[^\x00]+$")]
_Bool = Annotated[bool, Field(strict=True)]


class SettingsFile(Strict):
    """The file."""

    schema_: Literal["ori-deploy/mavlink/1"] = Field(alias="schema")
    system_id: _Id = Settings.system_id
    component_id: _Id = Settings.component_id
    autopilot_component: _Id = Settings.autopilot_component
    links: Annotated[tuple[str, ...], Field(max_length=MOST_LINKS)] = ()
    beyond_loopback: _Bool = Settings.beyond_loopback
    commanders: Annotated[tuple[_Id, ...], Field(max_length=255)] = Settings.commanders
    deploy_when: DeployWhen = Settings.deploy_when
    force_allowed: _Bool = Settings.force_allowed
    link_loss: LinkLoss = Settings.link_loss
    link_timeout_s: Annotated[float, Field(strict=True, ge=LEAST_LINK_TIMEOUT_S, le=60.0)] = Settings.link_timeout_s
    facts_fresh_s: Annotated[float, Field(strict=True, ge=0.2, le=10.0)] = Settings.facts_fresh_s
    telemetry_hz: Annotated[float, Field(strict=True, ge=0.2, le=20.0)] = Settings.telemetry_hz
    key_file: _FileName | None = None
    accept_unsigned: _Bool = Settings.accept_unsigned
    parameters_file: _FileName | None = None

    def settings(self, folder: Path) -> Settings:
        """Checked further; the names of files are taken from `folder`."""
        _refuse_own_place(self.component_id, self.autopilot_component)
        values = self.model_dump(exclude={"schema_", "links", "key_file", "parameters_file"})
        return Settings(
            **values,
            links=_links(self.links, self.beyond_loopback),
            key_file=None if self.key_file is None else folder / self.key_file,
            parameters_file=None if self.parameters_file is None else folder / self.parameters_file,
        )


def load_settings(path: Path) -> Settings:
    """Read a settings file. Names of files in it are relative to its folder.

    Raises
    ------
    FileError
        Unreadable, not TOML, unknown keys, values out of range, links that are none; names file and key.
    """
    data = read_toml(path, MAVLINK_SCHEMA)
    given = validated(SettingsFile, data, str(path))
    try:
        return given.settings(path.parent)
    except InputError as wrong:
        raise FileError(
            wrong.thing, value=wrong.value, limit=wrong.limit, remedy=wrong.remedy, source=str(path)
        ) from wrong


def with_links(settings: Settings, links: Sequence[str], beyond_loopback: bool = False) -> Settings:
    """The same with other links, where there are any, as a command line gives them.

    Raises
    ------
    InputError
        One of them is none, or listens on more than loopback where that was not said.
    """
    beyond = settings.beyond_loopback or beyond_loopback
    specs = tuple(parse_link(link, beyond) for link in links) or settings.links
    return dataclasses.replace(settings, links=specs, beyond_loopback=beyond)


def _links(texts: Sequence[str], beyond_loopback: bool) -> tuple[LinkSpec, ...]:
    specs: list[LinkSpec] = []
    for index, text in enumerate(texts):
        try:
            spec = parse_link(text, beyond_loopback)
        except InputError as wrong:
            raise InputError(
                f"key links[{index + 1}]: {wrong.thing}", value=wrong.value, limit=wrong.limit, remedy=wrong.remedy
            ) from wrong
        if spec in specs:
            raise InputError(f"key links[{index + 1}]: twice", value=text, limit="once", remedy="remove one of them")
        specs.append(spec)
    return tuple(specs)


def _refuse_own_place(component_id: int, autopilot_component: int) -> None:
    if component_id == autopilot_component:
        raise InputError(
            "key component_id: is the autopilot's",
            value=component_id,
            limit=f"another than autopilot_component = {autopilot_component}",
            remedy="take a number that nothing else on the vehicle has, as 140",
        )
