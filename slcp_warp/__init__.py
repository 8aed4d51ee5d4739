"""slcp-warp: thousands of small contact mechanisms stepped in parallel, differentiable through contact.

The contact problem of every time step is a stochastic complementarity problem (Tassa & Todorov 2010).
"""

__version__ = "0.1.0"
