"""Tasks: what is to be done with an arm, one folder for each.

A folder NAME here, with a class of the same name in its task.py, is the environment
dovetail/Name-v0; nothing else knows of it.
"""
