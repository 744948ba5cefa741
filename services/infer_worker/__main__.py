"""`python -m services.infer_worker`: one worker process of the infer stage."""

from services.infer_worker.app import main

if __name__ == "__main__":
    main()
