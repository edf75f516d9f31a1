"""`python -m pipeline.own.recorder FOLDER`: open the recorder on a folder."""

from pipeline.own.recorder.serve import main

if __name__ == "__main__":
    main()
