"""Where work units run: in processes of this machine, or on a Ray cluster.

Modules:
    protocol: executors, units, and the ways a unit can end.
    worker: the code of every worker.
    local: processes of this machine, or this process alone.
    cluster: a Ray cluster.
    options: --cluster and --jobs, and the executor that they name.
    folders: units that work in a folder, which travels where storage is not shared.
    policies: units that need the policy of a run.
    driver: hands units to an executor; lost workers, failures, Ctrl-C.
    progress: the one display of all that.

Run folders and journals hold the state and can be resumed to the bit; an executor only moves work. This package
imports no modules: Ray is loaded when a cluster is asked for.
"""
