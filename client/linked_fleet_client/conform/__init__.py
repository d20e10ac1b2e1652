from linked_fleet_client.conform.main import command

__all__ = ["command"]
