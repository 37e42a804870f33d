"""``python -m benchmarks.sweep``, from the repository's root."""

from benchmarks.sweep.trial import main

raise SystemExit(main())
