"""MJCF, MuJoCo's XML format, read into a Draft.

Uses what description shares (draft, xml_text), robot and forms.
"""
