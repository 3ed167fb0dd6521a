; dot_recursion.asm - calls without an end.

default rel
section .text
global dot
dot:
    call    dot
    ret
