"""The page in the browser."""

from vita.ui.app import App
from vita.ui.serving import serve

__all__ = ["App", "serve"]
