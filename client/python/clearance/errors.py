"""What the server or the connection objects to."""


class ClearanceError(Exception):
    """`code` is a grpc.StatusCode, `message` says what, where, got and expected."""

    def __init__(self, code, message):
        super().__init__(f"{code.name}: {message}")
        self.code = code
        self.message = message
