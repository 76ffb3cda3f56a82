"""Sweeps: designs over a grid, on all processors of a machine or of a cluster."""

from __future__ import annotations

from ori_deploy.sweep.backends import Backend, Cluster, Processes
from ori_deploy.sweep.grid import Grid, Job, parse_grid
from ori_deploy.sweep.job import run_job
from ori_deploy.sweep.jobs import jobs_of
from ori_deploy.sweep.run import Sweep
from ori_deploy.sweep.store import Store

__all__ = ["Backend", "Cluster", "Grid", "Job", "Processes", "Store", "Sweep", "jobs_of", "parse_grid", "run_job"]
