"""Policies that see an estimate of the state: a Kalman filter through contact, and who acts by it."""

from .estimated import Estimated
from .extended import Belief
from .kalman import KalmanFilter
from .sensors import Sensor

__all__ = ["Belief", "Estimated", "KalmanFilter", "Sensor"]
