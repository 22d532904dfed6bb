"""The gRPC channel to a server: plain or TLS, with or without a token."""

import collections

import grpc

_OPTIONS = [
    ("grpc.max_receive_message_length", 16 << 20),
    ("grpc.enable_http_proxy", 0),
    # A server that comes back is found at once, as by the C++ client.
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.min_reconnect_backoff_ms", 100),
    ("grpc.max_reconnect_backoff_ms", 1000),
]

_CallDetails = collections.namedtuple("_CallDetails", "method timeout metadata credentials wait_for_ready compression")


class _Details(_CallDetails, grpc.ClientCallDetails):
    pass


class _TokenInterceptor(grpc.UnaryUnaryClientInterceptor, grpc.UnaryStreamClientInterceptor,
                        grpc.StreamUnaryClientInterceptor, grpc.StreamStreamClientInterceptor):
    """gRPC attaches call credentials to secure channels only; a unix socket may ask for one, too."""

    def __init__(self, token):
        self._header = ("authorization", f"Bearer {token}")

    def _with_token(self, details):
        return _Details(details.method, details.timeout, list(details.metadata or []) + [self._header],
                        details.credentials, details.wait_for_ready, details.compression)

    def intercept_unary_unary(self, continuation, details, request):
        return continuation(self._with_token(details), request)

    intercept_unary_stream = intercept_unary_unary
    intercept_stream_unary = intercept_unary_unary
    intercept_stream_stream = intercept_unary_unary


def _read(path):
    if not path:
        return None
    with open(path, "rb") as file:
        return file.read()


def open_channel(address, token="", tls_ca="", tls_certificate="", tls_key=""):
    """Does not wait for the server. `address`: HOST:PORT, unix:PATH or the path of a socket."""
    target = f"unix:{address}" if address.startswith(("/", "./")) else address
    if tls_ca:
        credentials = grpc.ssl_channel_credentials(_read(tls_ca), _read(tls_key),
                                                   _read(tls_certificate))
        channel = grpc.secure_channel(target, credentials, options=_OPTIONS)
    else:
        channel = grpc.insecure_channel(target, options=_OPTIONS)
    return grpc.intercept_channel(channel, _TokenInterceptor(token)) if token else channel
