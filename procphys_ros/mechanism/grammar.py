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

"""Grammar of mechanism texts, for lark."""

from procphys_ros.language import EXPRESSION_GRAMMAR

# A name followed by a colon is a key, where a key is allowed: it ends the values before it.
MECHANISM_GRAMMAR = r"""
start: (include | mechanism | let | rule | material)+
include: "include" FILE
mechanism: "mechanism" NAME [_OPEN [parameter (_COMMA parameter)*] _CLOSE] "{" statement* "}"
parameter: NAME _EQUALS expression
material: "material" NAME "{" material_entry* "}"
material_entry: KEY _COLON expression -> entry
rule: "rule" NAME formals condition _ARROW "{" statement* "}" weight
formals: [_OPEN [NAME (_COMMA NAME)*] _CLOSE]
condition: [_COLON expression]
weight: [_COLON expression]
let: "let" NAME _EQUALS expression
?statement: let
    | "repeat" NAME _OPEN expression _CLOSE "{" statement* "}" -> repeat
    | NAME _OPEN [expression (_COMMA expression)*] _CLOSE [block] -> apply
    | thing
thing: NAME [NAME] block
block: "{" (entry | thing)* "}"
entry: KEY _COLON expression (_COMMA expression)*

FILE: /"[^"\n]*"/
KEY.2: /[A-Za-z_][A-Za-z0-9_]*(?=[ \t]*:)/
_COLON: ":"
_ARROW.2: "->"
_EQUALS: "="
%ignore /\s+/
%ignore /#[^\n]*/
""" + EXPRESSION_GRAMMAR

# Names of the terminals in messages.
MECHANISM_WORDS = {
    'KEY': 'a key with ":"', '_COLON': '":"', '_ARROW': '"->"', '_EQUALS': '"="',
    'LBRACE': '"{"', 'RBRACE': '"}"', 'FILE': 'a file name in quotes', 'INCLUDE': '"include"',
    'MECHANISM': '"mechanism"', 'RULE': '"rule"', 'MATERIAL': '"material"', 'LET': '"let"',
    'REPEAT': '"repeat"',
}
