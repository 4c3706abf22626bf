"""Files that are complete or not there, and files that are what they seem to be."""

from jssa_gym.storage.archives import (
    open_archive,
    read_array,
    read_header,
    read_member,
    read_sealed,
    write_archive,
    write_sealed,
)
from jssa_gym.storage.files import (
    append_whole,
    file_name,
    open_whole,
    read_text,
    read_whole,
    refused,
    sha256,
    whole_file,
    whole_lines,
    write_whole,
)
from jssa_gym.storage.json_files import as_json, write_json

__all__ = [
    "append_whole",
    "as_json",
    "file_name",
    "open_archive",
    "open_whole",
    "read_array",
    "read_header",
    "read_member",
    "read_sealed",
    "read_text",
    "read_whole",
    "refused",
    "sha256",
    "whole_file",
    "whole_lines",
    "write_archive",
    "write_json",
    "write_sealed",
    "write_whole",
]
