"""The 3D view: viser only. It draws what the studio says and posts what people do."""

from app.view.view import StudioView

__all__ = ["StudioView"]
