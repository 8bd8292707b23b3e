"""Other simulators on the reference problems, with settings that their documentation advises.

grips.py has MuJoCo and Drake with their own soft contacts, equations.py has Siconos and softpinch
with the equations of the problems.
"""
