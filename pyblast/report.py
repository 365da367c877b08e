"""stub"""
from .result import write_text


def write_report(path, result):
    write_text(path, "")
