"""Where evaluation finds its output folders and files: `dovetail.files`."""

from dovetail.files import claim_output_folder, write_atomic

__all__ = ["claim_output_folder", "write_atomic"]
