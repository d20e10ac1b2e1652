"""Extensions: one folder for each capability, mounted by one contract (``http.extension``, docs/EXTENDING.md).

The core imports none of them. They are independent, but for pages and for what they declare to need.
"""
