"""Fields become forces: one on each part with mass."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

from acausal.errors import GroundError, ModelError
from acausal.language.connector import Connector
from acausal.language.flatten import FlatSystem, Part
from acausal.parts.elastic_body import AbstractElasticBody
from acausal.parts.field import AbstractField, AbstractMutualField, FieldForce, PairForce
from acausal.parts.rigid import AbstractGround, AbstractRigidPart


def with_field_forces(flat: FlatSystem) -> FlatSystem:
    """The scene with a `FieldForce` between each field and each part with mass, except those that the field is fixed to.

    Raises `GroundError` for a field that stands nowhere, `ModelError` where bodies are elastic.
    """
    flat = _with_pairs(flat)
    fields = [part for part in flat.parts if isinstance(part.component, AbstractField)]
    if not fields:
        return flat
    _check_rigid(flat, fields[0])
    parts, paths = list(flat.parts), dict(flat.connector_paths)
    sets = _with_stands(flat, fields)
    place = {connector: k for k, members in enumerate(sets) for connector in members}
    for field in fields:
        assert isinstance(field.component, AbstractField)
        stands = sets[place[field.component.frame]]
        carriers = {connector.owner for connector in stands}
        for part in flat.parts:
            body = part.component
            if not isinstance(body, AbstractRigidPart) or body in carriers or body.inertia().is_zero:
                continue
            force = FieldForce(field.component, body)
            path = f"{field.path}[{part.path}]"
            parts.append(Part(path, force))
            paths |= {end: f"{path}.{end.name}" for end in force.connectors()}
            stands.append(force.frame_a)
            sets[place[force.seat]].append(force.frame_b)
    return replace(flat, parts=tuple(parts), connector_paths=paths, connection_sets=tuple(map(tuple, sets)))


def _check_rigid(flat: FlatSystem, field: Part) -> None:
    elastic = [part.where for part in flat.parts if isinstance(part.component, AbstractElasticBody)]
    if elastic:
        raise ModelError(f"{field.where} acts on rigid bodies and particles; {elastic[0]} is elastic. Use World's gravity there.")


def _with_pairs(flat: FlatSystem) -> FlatSystem:
    """The scene with a `PairForce` of each mutual field between any two parts with mass that are not fixed to one another at a connector."""
    fields = [part for part in flat.parts if isinstance(part.component, AbstractMutualField)]
    if not fields:
        return flat
    _check_rigid(flat, fields[0])
    parts, paths, sets = list(flat.parts), dict(flat.connector_paths), [list(members) for members in flat.connection_sets]
    place = {connector: k for k, members in enumerate(sets) for connector in members}
    bodies = [
        part for part in flat.parts if isinstance(part.component, AbstractRigidPart) and not part.component.inertia().is_zero
    ]
    for field, (one, other) in itertools.product(fields, itertools.combinations(bodies, 2)):
        assert isinstance(field.component, AbstractMutualField)
        assert isinstance(one.component, AbstractRigidPart) and isinstance(other.component, AbstractRigidPart)
        force = PairForce(field.component, one.component, other.component)
        seats = [place[seat] for seat in force.seats]
        if seats[0] != seats[1]:
            path = f"{field.path}[{one.path}, {other.path}]"
            parts.append(Part(path, force))
            paths |= {end: f"{path}.{end.name}" for end in force.connectors()}
            for seat, end in zip(seats, (force.frame_a, force.frame_b), strict=True):
                sets[seat].append(end)
    return replace(flat, parts=tuple(parts), connector_paths=paths, connection_sets=tuple(map(tuple, sets)))


def _with_stands(flat: FlatSystem, fields: Sequence[Part]) -> list[list[Connector]]:
    """The connection sets, with the frames of fields that touch nothing on the ground."""
    free = {part.component.frame for part in fields if isinstance(part.component, AbstractField)}
    free = {members[0] for members in flat.connection_sets if len(members) == 1 and members[0] in free}
    sets = [list(members) for members in flat.connection_sets if members[0] not in free]
    if free:
        grounds = [part.component for part in flat.parts if isinstance(part.component, AbstractGround)]
        if not grounds:
            raise GroundError(
                f"{fields[0].where} stands nowhere: the scene has no ground. Add scene.world = World(None), or connect its frame."
            )
        ground = grounds[0].attachments()[0].connector
        next(members for members in sets if ground in members).extend(sorted(free, key=lambda c: flat.connector_paths[c]))
    return sets
