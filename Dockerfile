# explore-bench on CPUs, without the rights of root:
#
#   docker build --tag explore-bench .
#   docker run --rm --volume "$PWD:/home/bench" --user "$(id -u):$(id -g)" explore-bench run smoke --results mine
#
# PyTorch without CUDA is a tenth of the size: give its index with --build-arg PIP_EXTRA_INDEX_URL=…
FROM python:3.11-slim

ARG PIP_EXTRA_INDEX_URL
ENV OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1

WORKDIR /opt/explore-bench
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY explore_bench explore_bench
COPY baselines baselines
RUN pip install --no-cache-dir --disable-pip-version-check --constraint constraints.txt . \
    && useradd --create-home bench

USER bench
WORKDIR /home/bench
ENTRYPOINT ["explore-bench"]
CMD ["--help"]
