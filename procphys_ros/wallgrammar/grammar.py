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

"""Grammar of wall grammar texts, for lark."""

from procphys_ros.language import EXPRESSION_GRAMMAR

# A name followed by a colon is a key, where a key is allowed: it ends the values before it.
WALL_GRAMMAR = r"""
start: (include | building | wing | rule | panel | material | layout)+
include: "include" FILE
building: "building" NAME [_OPEN [parameter (_COMMA parameter)*] _CLOSE] entry*
wing: "wing" NAME entry*
parameter: NAME _EQUALS expression
entry: KEY _COLON value*
?value: expression | _OPEN expression _COMMA expression _CLOSE -> point
material: "material" NAME "{" entry* "}"
layout: "layout" NAME "{" entry* "}"
panel: "panel" NAME _COLON expression
rule: "rule" NAME formals condition _ARROW successor weight
formals: [_OPEN NAME (_COMMA NAME)* _CLOSE]
condition: [_COLON expression]
weight: [_COLON expression]
?successor: NAME [_OPEN expression (_COMMA expression)* _CLOSE] -> apply
    | "split" _OPEN NAME _CLOSE "{" _parts "}" -> split
    | "border" _OPEN expression _CLOSE "{" successor _BAR successor "}" -> border
    | "grid" _OPEN expression _COMMA expression _CLOSE "{" successor "}" -> grid
    | "extrude" _OPEN expression _CLOSE "{" successor "}" -> extrude
    | "insert" _OPEN expression _COMMA expression _CLOSE "{" successor _BAR successor "}" -> insert
_parts: part (_BAR part)*
?part: expression _COLON successor -> absolute
    | _QUOTE expression _COLON successor -> relative
    | _TILDE expression _COLON successor -> floating
    | "{" _parts "}" _TIMES -> repeat

FILE: /"[^"\n]*"/
KEY.2: /[A-Za-z_][A-Za-z0-9_]*(?=[ \t]*:)/
_COLON: ":"
_ARROW.2: "->"
_BAR: "|"
_QUOTE: "'"
_TILDE: "~"
_EQUALS: "="
%ignore /\s+/
%ignore /#[^\n]*/
""" + EXPRESSION_GRAMMAR

# Names of the terminals in messages.
WALL_WORDS = {
    'KEY': 'a key with ":"', '_COLON': '":"', '_ARROW': '"->"', '_BAR': '"|"', '_QUOTE': '"\'"',
    '_TILDE': '"~"', '_EQUALS': '"="', 'LBRACE': '"{"', 'RBRACE': '"}"',
    'FILE': 'a file name in quotes', 'INCLUDE': '"include"',
    'BUILDING': '"building"', 'WING': '"wing"', 'RULE': '"rule"', 'PANEL': '"panel"',
    'MATERIAL': '"material"', 'LAYOUT': '"layout"', 'SPLIT': '"split"', 'BORDER': '"border"',
    'GRID': '"grid"',
    'EXTRUDE': '"extrude"', 'INSERT': '"insert"',
}
