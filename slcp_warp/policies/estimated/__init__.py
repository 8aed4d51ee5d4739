"""Policies that see an estimate of the state: a Kalman filter through contact, and who acts by it."""

from .estimated import Estimated
from .kalman import Belief, KalmanFilter

__all__ = ["Belief", "Estimated", "KalmanFilter"]
