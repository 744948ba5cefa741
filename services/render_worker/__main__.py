"""`python -m services.render_worker`: one worker process of the render stage."""

from services.render_worker.app import main

if __name__ == "__main__":
    main()
