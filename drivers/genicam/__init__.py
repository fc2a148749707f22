"""Machine-vision cameras over GenICam: GigE Vision and USB3 Vision, through Aravis.

Optional (extra `genicam`). `aravis` alone imports gi. What the cameras send are packed numbers, which `pixel_formats`
unpacks; the camera writes them as DNGs.
"""
