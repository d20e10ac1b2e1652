from redis_backends import pytest_pyfunc_call, server, valkey, valkey_cluster  # noqa: F401 - fixtures and a hook
