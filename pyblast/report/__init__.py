"""Report pages, figures and files for ParaView."""
