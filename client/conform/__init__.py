from client.conform.main import command

__all__ = ["command"]
