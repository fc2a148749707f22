"""Machine-vision cameras over GenICam: GigE Vision and USB3 Vision, through Aravis.

Optional (extra `genicam`). Only `aravis` imports gi. The cameras send packed pixels, which `pixel_formats`
unpacks; the camera writes them as DNGs.
"""
