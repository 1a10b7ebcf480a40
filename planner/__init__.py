"""Decisions: perception, exposure, costs, methods, learning and the mission loop.

Importing it makes `gymnasium.make("CoverNav-v0")` known; see `planner.environment.CoverNavEnv`.
"""

from gymnasium.envs.registration import register

register(id="CoverNav-v0", entry_point="planner.environment:CoverNavEnv")
