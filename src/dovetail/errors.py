"""Exceptions of dovetail: each says what is wrong, where, and what to do next."""


class DovetailError(Exception):
    """Base of every error that dovetail raises on purpose."""


class ConfigError(DovetailError, ValueError):
    """A setting, argument or configuration file is wrong."""


class LimitError(DovetailError, ValueError):
    """A state or command lies outside a limit."""


class PlantError(DovetailError, RuntimeError):
    """A simulated plant cannot be built or has failed."""


class PolicyError(DovetailError, ValueError):
    """A policy file is damaged or does not fit the task."""


class LogError(DovetailError, OSError):
    """An Episode log cannot be written or is not valid."""


class MissingDependencyError(DovetailError, ImportError):
    """An optional package is needed and not installed."""
