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


"""Grammar of arithmetic, as a text to be embedded in a larger lark grammar."""

# Embed by appending to a grammar that is read with parser='lalr', propagate_positions=True.
# Entry rule: `expression`. Strings of the larger grammar such as "(" meet the terminals below.
EXPRESSION_GRAMMAR = r"""
?expression: conjunction
    | expression _OR conjunction -> either
?conjunction: comparison
    | conjunction _AND comparison -> both
?comparison: sum
    | comparison COMPARE sum -> compare
    | comparison _LESS sum -> less
    | comparison _MORE sum -> more
?sum: product
    | sum _PLUS product -> add
    | sum _MINUS product -> subtract
?product: unary
    | product _TIMES unary -> multiply
    | product _OVER unary -> divide
    | product _MODULO unary -> modulo
?unary: power
    | _MINUS unary -> negative
    | _PLUS unary
    | _NOT unary -> negation
?power: atom
    | atom _POWER unary -> power
?atom: NUMBER -> number
    | NAME -> variable
    | NAME _OPEN [expression (_COMMA expression)*] _CLOSE -> call
    | _OPEN expression _CLOSE

_OR: "||"
_AND: "&&"
COMPARE: "==" | "!=" | "<=" | ">="
_LESS: "<"
_MORE: ">"
_PLUS: "+"
_MINUS: "-"
_TIMES: "*"
_OVER: "/"
_MODULO: "%"
_NOT: "!"
_POWER: "^"
_OPEN: "("
_CLOSE: ")"
_COMMA: ","
NUMBER: /(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?/
NAME: /[A-Za-z_][A-Za-z0-9_]*/
"""

# Names of the terminals above in messages; a larger grammar adds its own.
EXPRESSION_WORDS = {
    '_OR': 'an operator', '_AND': 'an operator', 'COMPARE': 'an operator',
    '_LESS': 'an operator', '_MORE': 'an operator', '_PLUS': 'an operator',
    '_MINUS': 'an operator', '_TIMES': 'an operator', '_OVER': 'an operator',
    '_MODULO': 'an operator', '_NOT': 'a value', '_POWER': 'an operator',
    '_OPEN': '"("', '_CLOSE': '")"', '_COMMA': '","',
    'NUMBER': 'a number', 'NAME': 'a name', '$END': 'the end',
}
