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

"""Air: density, viscosity and drag coefficients of common shapes."""

AIR_DENSITY = 1.225  # [kg/m³], standard atmosphere at sea level (ISO 2533)
AIR_VISCOSITY = 1.789e-5  # [Pa·s] at 15 °C (ISO 2533)
# Drag of a long cylinder across the wind, subcritical (Hoerner 1965, Fluid-Dynamic Drag, 3-9).
CYLINDER_DRAG = 1.1  # [-]
CUBE_DRAG = 1.05  # [-], face on (Hoerner 1965, 3-16)
PLATE_DRAG = 1.17  # [-], flat, across the flow (Hoerner 1965, 3-16)
LEAF_DRAG = 0.4  # [-], per one-sided area, of an unsheltered leaf; see below
# Drag of foliage per one-sided leaf area, in terms of the wind that reaches the crown. One leaf
# alone has 0.4 (canopy models use F = 0.2·ρ·a·u² with the speed between the leaves; Shaw and
# Schumann 1992, Boundary-Layer Meteorology 61:47), but in a crown most leaves are in the lee of
# others. Calibrated on ForestGALES (R package fgr): the force on a whole tree, its wood included,
# is ½·ρ·C·v^-N·A·u² with v = u within 10 to 20 or 25 m/s and A = crown depth · breadth / 2. C and
# N are 2.6575 and 0.846 for oak, 1.9627 and 0.881 for birch, 3.07 and 0.75 for Scots pine: 1362,
# 493 and 1185 N at 10 m/s for the shipped trees. Less 250, 130 and 296 N on their wood, over 345,
# 105 and 180 m² of leaves, 0.051, 0.057 and 0.084 remain; with one value whole trees are
# within 30 %.
FOLIAGE_DRAG = 0.06  # [-]
# Foliage folds: from 10 to 25 m/s its drag goes with u^(2 + V), V being the Vogel exponent of the
# species (Vogel 1989, J. Exp. Botany 40:941); beyond that ForestGALES keeps the coefficient
# constant. Below 10 m/s leaves have hardly moved. -1, drag proportional to speed, was measured by
# Vollsinger et al. 2005 (Can. J. For. Res. 35:1238) for cottonwood, alder and birch. The wood
# does not fold: with -1 whole trees follow u^1.3 to u^1.4 between 10 and 20 m/s.
CALM, STORM = 10.0, 25.0  # [m/s] between which foliage folds
VOGEL_EXPONENT = -1.0  # default of foliage

# Gale force 8 (17 m/s) breaks twigs (WMO Beaufort scale); white poplar leaves hold at 30 m/s
# (Vogel 1989).
SHEDDING_SPEED = 17.0  # [m/s], default of the least wind that tears off a leaf
