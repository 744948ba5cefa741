"""`python -m services.eval_worker`: one worker process of the eval stage."""

from services.eval_worker.app import main

if __name__ == "__main__":
    main()
