"""Solvers of a step's complementarity problem, by contact law: convex, Coulomb, ERM."""
