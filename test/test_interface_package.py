# Copyright 2026 The procphys_ros authors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.


"""The package `simulation_interfaces` there, not there, old, and half there."""

import sys
from types import SimpleNamespace

from interface_stand_ins import TYPES
import pytest

from procphys_ros.ros import simulation_interfaces


def test_nothing_is_offered_without_the_package(monkeypatch):
    """Do without services when their package cannot be imported."""
    monkeypatch.setattr(simulation_interfaces, 'PACKAGE', 'no_such_package')
    assert simulation_interfaces.offer(None, None, None, None) == []


class BrokenKind:
    """A type of services whose library was not installed with it."""


@pytest.mark.parametrize('modules, reason', [
    ({'msg': None}, 'ModuleNotFoundError'), ({'srv': None}, 'ModuleNotFoundError'),
    ({'msg': SimpleNamespace()}, 'Result'), ({}, 'no library')])
def test_a_package_that_is_half_there_does_not_end_the_node(monkeypatch, modules, reason):
    """Warn, and offer nothing of it; services that could be created are taken back."""
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', SimpleNamespace())
    whole = {'msg': TYPES, 'srv': SimpleNamespace(GetEntities=object, StepSimulation=object,
                                                  SpawnEntity=BrokenKind), 'action': None}
    for name, module in (whole | modules).items():
        monkeypatch.setitem(sys.modules, f'simulation_interfaces.{name}', module)
    standing, said = [], []

    def create_service(kind, name, serve, callback_group):
        if kind is BrokenKind:
            raise RuntimeError('no library')
        standing.append(name)
        return name
    node = SimpleNamespace(create_service=create_service, destroy_service=standing.remove,
                           context=SimpleNamespace(ok=lambda: True),
                           get_logger=lambda: SimpleNamespace(warning=said.append),
                           get_parameter=lambda name: SimpleNamespace(value='world'))
    assert simulation_interfaces.offer(node, SimpleNamespace(group=''), None, None) == []
    assert not standing and len(said) == 1 and reason in said[0] and 'install it anew' in said[0]


def test_services_are_offered_where_the_package_has_them(monkeypatch):
    """Offer each service that the package defines under its own name, and no other."""
    kinds = SimpleNamespace(GetEntities=object(), StepSimulation=object(), LoadWorld=object(),
                            SpawnEntity=object())
    actions = SimpleNamespace(SimulateSteps=object())
    monkeypatch.setitem(sys.modules, 'simulation_interfaces', SimpleNamespace())
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.msg', TYPES)
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.srv', kinds)
    monkeypatch.setitem(sys.modules, 'simulation_interfaces.action', actions)
    made = {}

    def create_action(node, kind, name, serve, callback_group, cancel_callback):
        made[name] = kind, serve.__name__, callback_group
    monkeypatch.setattr(simulation_interfaces, 'ActionServer', create_action)

    def create_service(kind, name, serve, callback_group):
        made[name] = kind, serve.__name__, callback_group
    node = SimpleNamespace(create_service=create_service,
                           get_parameter=lambda name: SimpleNamespace(value='world'))
    answers = SimpleNamespace(group='group')
    offered = simulation_interfaces.offer(node, answers, None, None)
    assert offered == ['step_simulation', 'get_entities', 'spawn_entity', 'simulate_steps']
    assert made == {f'~/simulation_interfaces/{name}': (kind, name, 'group') for name, kind in (
        ('get_entities', kinds.GetEntities), ('step_simulation', kinds.StepSimulation),
        ('spawn_entity', kinds.SpawnEntity), ('simulate_steps', actions.SimulateSteps))}
