from tests.procedures.field.conftest import covariance

__all__ = ["covariance"]
