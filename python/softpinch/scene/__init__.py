"""What is simulated: hand, object, control, schedule, disturbances, and where it starts.

Descriptions are frozen, checked once, and compiled here to the numbers that the core takes. Here
are also the dotted paths into a scene, the units of its numbers, and what is usual for them.
"""
