"""Long computations in chunks: a job, its store on disk, executors that share the work, progress.

Nothing here knows what is computed. A job says how many chunks there are and what is in each; the store
keeps every finished one; which are missing decides what is left to do.
"""
