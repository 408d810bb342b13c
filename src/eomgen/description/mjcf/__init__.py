"""MJCF, MuJoCo's XML format, read into a Draft.

Uses robot, and of description the draft and xml_text.
"""
